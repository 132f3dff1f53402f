"""The runs that are timed: practical_pd_ddob at 100 Hz on a minute of the ellipse."""

from collections.abc import Sequence

from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.settings import PlantSettings, plant_preset

DURATION_S = 60.0
NETWORKS = {
    "80 ms": ("mean_s=0.08",),
    "83.7213 ms, off the grid": ("mean_s=0.0837213",),
    "80 ± 30 ms, 1 % lost": ("model=gamma", "mean_s=0.08", "spread_s=0.03", "loss=0.01"),
}


def pair_settings(
    network: Sequence[str], duration_s: float = DURATION_S
) -> tuple[PlantSettings, ControllerSettings]:
    """Return a run of practical_pd_ddob at 100 Hz on a network."""
    plant = plant_preset(
        "paper_corner_d",
        [f"duration_s={duration_s}", *(f"latency.downlink.{setting}" for setting in network)],
    )
    return plant, controller_preset("practical_pd_ddob")
