"""Why the delay is measured: a predictor that assumes a constant one, beside the one that measures.

The latency of the commands is 300 ± 90 ms, 2 % are lost, and the newest wins. A command that is
overtaken never acts, so those that act are younger than the mean latency; by how much depends on
the distribution.
"""

import numpy as np
import pytest

from steer_by_wire.closed_loop.virtual_pair import run_virtual_nodes
from steer_by_wire.controller.history.history import RING_SIZE, BusHistory
from steer_by_wire.controller.law_interface import LoopDelay
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import LateralError, SteeringStatus
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset

ASSUMED_NS = 300_000_000
JITTERY = (
    "duration_s=25",
    "latency.downlink.model=normal",
    "latency.downlink.mean_s=0.3",
    "latency.downlink.spread_s=0.09",
    "latency.downlink.loss=0.02",
)
CONSTANT = (
    "duration_s=14",
    "latency.downlink.mean_s=0.3",
)


class AssumingMemory(BusHistory):
    """Believes every command to act ``ASSUMED_NS`` after it was sent, and ignores the echoes.

    The two clocks agree in these runs: the first tick comes with sample 0, and nothing delays
    measurements.
    """

    def on_echo(self, status: SteeringStatus, counter: int, now_ns: int) -> None:
        pass

    def on_error(self, error: LateralError, counter: int, now_ns: int) -> None:
        super().on_error(error, counter, now_ns)
        sample, params = self._errors.sample, self._params.loop_delay
        at_ns = sample * params.sensor_period_ns - ASSUMED_NS
        self._rings.applied_tick[sample % RING_SIZE] = max(at_ns // params.period_ns, -1)

    def loop_delay(self, period: int, now_ns: int) -> LoopDelay:
        loop_delay = super().loop_delay(period, now_ns)
        delay_ns = ASSUMED_NS - 0.5 * self._params.loop_delay.period_ns
        return loop_delay._replace(
            echo_sample=loop_delay.error_sample, delay_ns=delay_ns, is_measured=True
        )


def settled_rms_m(overrides: tuple[str, ...], corner: str) -> float:
    ellipse = 'path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}'
    plant = plant_preset(f"paper_corner_{corner}", [ellipse, *overrides])
    controller = controller_preset("practical_predictor")
    plant_node = PlantNode(plant, 0)
    run_virtual_nodes(plant_node, ControllerNode(controller, 0), None, None, lambda: False)
    errors_m = np.array([sample.lateral_error_m for sample in plant_node.samples])
    return float(np.sqrt(np.mean(errors_m[500:] ** 2)))


def test_a_constant_delay_may_as_well_be_assumed_as_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured_m = settled_rms_m(CONSTANT, "d")
    monkeypatch.setattr("steer_by_wire.controller.node.law_runner.BusHistory", AssumingMemory)
    assert settled_rms_m(CONSTANT, "d") == pytest.approx(measured_m, rel=0.05)


def test_under_jitter_an_assumed_delay_costs_several_times_the_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured_m = settled_rms_m(JITTERY, "d")
    assert measured_m < 0.0005
    monkeypatch.setattr("steer_by_wire.controller.node.law_runner.BusHistory", AssumingMemory)
    assert 5.0 * measured_m < settled_rms_m(JITTERY, "d") < 0.01
