"""Commands stay away, the steering falls back, and laws that look back know where the wheel was."""

import math

import numpy as np
import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import SteeringStatus, SteeringStatusCode
from steer_by_wire.plant_emulator.faults.stage import with_faults
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from tests.support.frames.made_messages import message_with
from tests.support.nodes.fed_history import MS, PERIOD_NS, FedHistory, driven

ONSET_S = 6.0


class Outage:
    """A run with an outage of the commands; what the controller sent in the 3 s after it."""

    def __init__(self, outage_s: float, delay_s: float) -> None:
        drop = 'kind="drop", direction="downlink", message="STEERING_COMMAND", magnitude=1.0'
        fault = f"faults=[{{{drop}, onset_s={ONSET_S}, duration_s={outage_s}}}]"
        plant = plant_preset(
            "paper_nominal",
            [
                "path.semi_major_axis_m=60",
                "path.semi_minor_axis_m=30",
                f"duration_s={ONSET_S + outage_s + 3}",
                f"latency.downlink.mean_s={delay_s}",
                fault,
            ],
        )
        law = controller_preset("practical_predictor")
        self.plant, controller = PlantNode(plant, 0), ControllerNode(law, 0, 10_000)
        edge = with_faults(self.plant, plant.faults, plant.seed)
        run_virtual_nodes(edge, controller, None, None, lambda: False)
        ticks = [s for s in controller.samples if s.time_ns >= (ONSET_S + outage_s) * 1e9]
        sent_rad = np.array([tick.sent_steer_rad for tick in ticks])
        self.rates_rad_s = np.diff(sent_rad) * 100.0
        self.report = controller.report()


@pytest.mark.parametrize(("outage_s", "delay_s"), [(0.9, 0.0), (1.1, 0.0), (1.1, 0.4)])
def test_the_predictors_steer_is_calm_after_an_outage(outage_s: float, delay_s: float) -> None:
    """The steering fell back; with the command believed instead the rate reached its limit, 2."""
    run = Outage(outage_s, delay_s)
    assert run.plant.report()["safety"]["fallbacks"] == 1
    # The path's curvature after an outage, times the weight of the error (1.7) in the design.
    assert 0.05 < np.max(np.abs(run.rates_rad_s)) < 0.4
    assert math.sqrt(np.mean(run.rates_rad_s**2)) < 0.12


def test_an_outage_says_nothing_of_the_delay() -> None:
    """Echoes go on naming the last command followed, which grows old."""
    fed = driven(100, 5)
    assert fed.loop_delay(99).delay_ns == 45 * MS
    for code in (
        SteeringStatusCode.HOLDING,
        SteeringStatusCode.FALLBACK,
        SteeringStatusCode.SAFE_STATE,
    ):
        reported(fed, 100, 94, code)
        assert fed.history.loop_delay(100, 100 * PERIOD_NS).delay_ns == 45 * MS
    reported(fed, 101, 94, SteeringStatusCode.LIMITED_BY_SAFETY)
    assert fed.history.loop_delay(101, 101 * PERIOD_NS).delay_ns > 45 * MS


def reported(fed: FedHistory, sample: int, counter: int, code: SteeringStatusCode) -> None:
    """Echo of a sample with the wheel at a thousandth of its number."""
    status = message_with(
        SteeringStatus, wheel_angle_rad=0.001 * sample, applied_counter=counter, status=code
    )
    fed.history.on_echo(status, sample % 256, sample * PERIOD_NS)


@pytest.mark.parametrize(
    ("code", "is_overruled"),
    [
        (SteeringStatusCode.NO_COMMAND, False),
        (SteeringStatusCode.APPLYING, False),
        (SteeringStatusCode.LIMITED, False),
        (SteeringStatusCode.LIMITED_BY_SAFETY, True),
        (SteeringStatusCode.HOLDING, True),
        (SteeringStatusCode.FALLBACK, True),
        (SteeringStatusCode.SAFE_STATE, True),
    ],
)
def test_the_wheel_is_remembered_where_its_command_does_not_act(
    code: SteeringStatusCode, is_overruled: bool
) -> None:
    fed = driven(100, 5)
    reported(fed, 100, 94, code)
    history = fed.history.history
    assert history.is_overruled[100] is is_overruled
    assert history.wheel_rad[100] == pytest.approx(0.1)
    assert not any(history.is_overruled[:100])


def test_where_echoes_are_lost_the_wheel_is_taken_to_stay() -> None:
    fed = driven(100, 5)
    reported(fed, 100, 94, SteeringStatusCode.FALLBACK)
    reported(fed, 104, 100, SteeringStatusCode.APPLYING)
    history = fed.history.history
    assert history.is_overruled[99:105] == [False, True, True, True, True, False]
    assert history.wheel_rad[100:104] == pytest.approx([0.1] * 4)
