"""Shipped predictor while no echo comes, at the delays that it is shipped for."""

import numpy as np

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset

ONSET_S, END_S = 2.0, 7.0
NO_ECHOES = (
    f'faults=[{{kind="drop", direction="uplink", message="STEERING_STATUS", onset_s={ONSET_S},'
    f" duration_s={END_S - ONSET_S}, magnitude=1.0}}]"
)


def without_echoes(delay_s: float, overrides: tuple[str, ...] = ()) -> tuple[float, float]:
    """Return the largest error [m] and step of the steer [rad] from the loss on, at corner d."""
    plant = plant_preset(
        "paper_corner_d",
        (
            f"duration_s={END_S}",
            'path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}',
            f"latency.downlink.mean_s={delay_s}",
            NO_ECHOES,
        ),
    )
    controller = controller_preset("practical_predictor", overrides)
    pair = make_virtual_pair(plant, controller, controller_samples_max=1000)
    run_virtual_nodes(pair.edge, pair.controller, None, None, lambda: False)
    assert pair.controller.report()["stale"]["steering_status"] == 1
    errors_m = [s.lateral_error_m for s in pair.plant.samples if s.time_s > ONSET_S]
    sent_rad = [s.sent_steer_rad for s in pair.controller.samples if s.time_ns > ONSET_S * 1e9]
    return float(np.abs(errors_m).max()), float(np.abs(np.diff(sent_rad)).max())


def test_without_echoes_it_stays_on_the_path_and_the_steer_does_not_jump() -> None:
    error_m, step_rad = without_echoes(0.5)
    assert error_m < 0.06
    assert step_rad < 0.0025  # 0.2 rad/s, the fade, is 0.002 in a period
