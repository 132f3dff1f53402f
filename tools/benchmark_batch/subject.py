"""The runs that are timed: practical_pd_ddob at 100 Hz on a minute of the ellipse."""

from collections.abc import Sequence

from ...controller.settings import ControllerSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.settings import load_settings, read_preset

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
    plant = load_settings(
        PlantSettings,
        read_preset("steer_by_wire.plant_emulator.presets", "paper_corner_d"),
        None,
        [f"duration_s={duration_s}", *(f"latency.downlink.{setting}" for setting in network)],
    )
    preset = read_preset("steer_by_wire.controller.presets", "practical_pd_ddob")
    return plant, load_settings(ControllerSettings, preset, None, [])
