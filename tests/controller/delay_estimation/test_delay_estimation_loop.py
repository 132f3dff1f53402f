"""The estimated delay while both nodes run, right to a control period; and where it is absent."""

from functools import cache
from typing import Any

import pytest

from steer_by_wire.controller.delay_estimation.delay_estimator import (
    DelayEstimationSettings,
    delay_estimation_of,
)
from steer_by_wire.controller.filters.settings import PaperEq19Settings
from steer_by_wire.controller.node.newest_messages import Received
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.node.reported_delay import EchoDelay, ReportedDelay
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import Decoded, DelayStatus, EchoState, EstimateState, decode
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor

PERIOD_NS = 10_000_000
TOLERANCE_S = 0.01


def plant_settings(path: dict[str, Any], corner: tuple[float, float], delay_s: float) -> Any:
    way = {"mean_s": delay_s / 2.0}
    return PlantSettings.model_validate(
        {
            "duration_s": 24.0,
            "path": path,
            "vehicle": {"speed_m_s": corner[0] / 3.6, "virtual_mass_kg": corner[1]},
            "latency": {"downlink": way, "uplink": way},
        }
    )


def controller_settings(law: str, *overrides: str) -> ControllerSettings:
    return controller_preset(f"practical_{law}", overrides)


class Run:
    """One run in virtual time, and what the wire carried."""

    def __init__(self, plant: PlantSettings, controller: ControllerSettings) -> None:
        self.statuses: list[DelayStatus] = []
        self.steer: list[bytes] = []
        self.node = ControllerNode(controller, 0)
        plant_node = PlantNode(plant, 0, samples_max=0)
        executor = VirtualTimeExecutor((plant_node, self.node), None, self._on_wire)
        until_ns = NS_PER_S
        while not executor.finished:
            executor.run(until_ns)
            until_ns += NS_PER_S

    def _on_wire(self, _time_ns: int, _sender: int, frame: Frame) -> None:
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        if isinstance(decoded.message, DelayStatus):
            self.statuses.append(decoded.message)
        elif frame.can_id == 0x100:
            self.steer.append(frame.data)

    @property
    def observable(self) -> list[DelayStatus]:
        return [one for one in self.statuses if one.estimate_state is EstimateState.OBSERVABLE]


@cache
def run(law: str, path: str, speed_km_h: float, mass_kg: float, delay_s: float) -> Run:
    plant = plant_settings(PATHS[path], (speed_km_h, mass_kg), delay_s)
    return Run(plant, controller_settings(law))


PATHS: dict[str, dict[str, Any]] = {
    "lane change": {"kind": "double_lane_change", "start_m": 2.0},
    "ellipse": {"kind": "ellipse", "semi_major_axis_m": 60.0, "semi_minor_axis_m": 30.0},
    "straight": {"kind": "straight"},
    "circle": {"kind": "circle", "radius_m": 50.0},
}


@pytest.mark.parametrize(
    ("law", "path", "speed_km_h", "mass_kg", "delay_s"),
    [
        ("pd", "lane change", 4.0, 1600.0, 0.08),
        ("pd_ddob", "lane change", 7.0, 5000.0, 0.25),
        ("pd_cdob", "ellipse", 7.0, 5000.0, 0.08),
        ("predictor", "ellipse", 4.0, 1600.0, 0.25),
    ],
)
def test_while_observable_it_is_right_to_a_control_period(
    law: str, path: str, speed_km_h: float, mass_kg: float, delay_s: float
) -> None:
    driven = run(law, path, speed_km_h, mass_kg, delay_s)
    assert len(driven.observable) > 0.15 * len(driven.statuses)
    errors_s = [one.estimated_delay_s - delay_s for one in driven.observable]
    assert max(map(abs, errors_s)) <= TOLERANCE_S + 1e-9
    assert all(one.confidence >= 0.945 for one in driven.observable)


def test_the_echo_is_reported_beside_it_within_half_a_period() -> None:
    driven = run("pd", "lane change", 4.0, 1600.0, 0.08).statuses
    assert driven[0].echo_state is EchoState.UNKNOWN
    assert driven[-1].echo_state is EchoState.KNOWN
    assert driven[-1].echo_delay_s == pytest.approx(0.08, abs=0.0055)


def test_on_a_straight_road_nothing_is_observable() -> None:
    driven = run("pd", "straight", 5.0, 2000.0, 0.08)
    assert driven.observable == []
    assert {one.estimate_state for one in driven.statuses} == {EstimateState.NOT_OBSERVABLE}
    report = driven.node.report()["delay"]
    assert report["estimate_s"] is None
    assert report["observable_share"] == 0.0
    assert report["first_observable_s"] is None


def test_in_a_steady_circle_what_was_observable_at_its_start_is_so_no_more() -> None:
    plant = plant_settings(PATHS["circle"], (5.0, 2000.0), 0.08)
    driven = Run(plant.model_copy(update={"duration_s": 60.0}), controller_settings("pd"))
    assert driven.observable
    late = driven.statuses[-200:]
    assert {one.estimate_state for one in late} == {EstimateState.NOT_OBSERVABLE}
    # The last estimate remains reported.
    assert late[-1].estimated_delay_s == pytest.approx(0.08, abs=TOLERANCE_S)


def test_the_report_agrees_with_the_bus() -> None:
    driven = run("pd_ddob", "lane change", 7.0, 5000.0, 0.25)
    report = driven.node.report()["delay"]
    share = len(driven.observable) / len(driven.statuses)
    assert report["observable_share"] == pytest.approx(share, abs=0.02)
    assert report["estimate_s"] == pytest.approx(driven.statuses[-1].estimated_delay_s, abs=5e-4)
    assert report["echo_s"] == pytest.approx(driven.statuses[-1].echo_delay_s, abs=5e-4)


def test_switched_off_it_is_off_and_the_commands_are_the_same_to_the_last_bit() -> None:
    plant = plant_settings(PATHS["lane change"], (4.0, 1600.0), 0.08)
    off = Run(plant, controller_settings("pd", "delay_estimation.enabled=false"))
    assert {one.estimate_state for one in off.statuses} == {EstimateState.OFF}
    assert {one.confidence for one in off.statuses} == {0.0}
    assert off.statuses[-1].echo_state is EchoState.KNOWN
    assert off.steer == run("pd", "lane change", 4.0, 1600.0, 0.08).steer
    assert off.node.report()["delay"]["estimate_state"] == "off"


def test_without_a_nominal_vehicle_it_is_off() -> None:
    table = DelayEstimationSettings()
    assert delay_estimation_of(table, None, PERIOD_NS) is None
    assert delay_estimation_of(table, PaperEq19Settings(kind="paper_eq19"), PERIOD_NS) is None
    watch = ReportedDelay(None, EchoDelay(PERIOD_NS, NS_PER_S, NS_PER_S))
    watch.on_tick(0, 0, 0.0, Received(controller_settings("pd")))
    assert watch.status(0) == DelayStatus(0.0, 0.0, EchoState.UNKNOWN, EstimateState.OFF, 0.0)
