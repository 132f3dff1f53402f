"""Both nodes, their frames and virtual time: the loop as it is meant to run, to the last bit."""

from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.law_interface import LawInput
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import (
    Decoded,
    Message,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    decode,
)
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.network.settings import (
    BothLatencySettings,
    LatencySettings,
    Order,
)
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.path.settings import EllipseSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.exact_propagation import Y
from steer_by_wire.plant_emulator.vehicle.motion_parameters import motion_params
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor

MS_NS = 1_000_000
S_NS = 1_000_000_000
PERIOD_NS = 10 * MS_NS
LAWS = ("pd", "pd_dob", "pd_cdob", "pd_ddob")
ELLIPSE = EllipseSettings(semi_major_axis_m=60.0, semi_minor_axis_m=30.0)
LATERAL_ERROR_RESOLUTION_M = 5e-6
STEER_RESOLUTION_RAD = 1e-5


def preset(name: str, *overrides: str) -> ControllerSettings:
    return controller_preset(name, overrides)


def plant_settings(
    duration_s: float,
    downlink: LatencySettings | None = None,
    uplink: LatencySettings | None = None,
    seed: int = 1,
    sensor_period_ms: float = 10.0,
) -> PlantSettings:
    return PlantSettings(
        seed=seed,
        duration_s=duration_s,
        sensor_period_ms=sensor_period_ms,
        path=ELLIPSE,
        latency=BothLatencySettings(
            downlink=downlink or LatencySettings(), uplink=uplink or LatencySettings()
        ),
    )


class ReceivedMessage(NamedTuple):
    """A message, complete on the wire at ``time_ns``."""

    time_ns: int
    message: Message


class Run(NamedTuple):
    """Both nodes after a run, and what was received from the wire."""

    plant: PlantNode
    controller: ControllerNode
    heard: list[ReceivedMessage]

    @property
    def commands(self) -> list[tuple[int, SteeringCommand]]:
        return [(at_ns, said) for at_ns, said in self.heard if isinstance(said, SteeringCommand)]

    @property
    def rms_m(self) -> float:
        rms_m: float = self.plant.report()["preview_rms_m"]
        return rms_m


def run(plant: PlantSettings, controller: ControllerSettings, bus: BusModel | None = None) -> Run:
    """Run to the end of the motion, on a wire without time unless a ``bus`` is given."""
    result = Run(PlantNode(plant, 0), ControllerNode(controller, 0), [])

    def listen(time_ns: int, _sender: int, frame: Frame) -> None:
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        result.heard.append(ReceivedMessage(time_ns, decoded.message))

    VirtualTimeExecutor((result.plant, result.controller), bus, listen).run(NEVER_NS)
    assert result.plant.finished
    return result


def textbook_loop(
    plant: PlantSettings, controller: ControllerSettings
) -> list[tuple[float, float]]:
    """Lateral error [m] and the command in effect [rad] at every sample after the first.

    Sense, round to the wire's resolution, control, limit, round, hold. As in the node, the law gets
    its own command after the limits, not rounded to the wire's resolution.
    """
    design = design_law(controller)
    angle_rad = controller.limits.steer_rad_max
    step_rad = controller.limits.steer_rate_rad_s_max * controller.period_ns / S_NS
    motion = Motion(motion_params(plant.vehicle, plant.actuator, plant.path, plant.disturbance))
    state, steer_rad, held_rad = design.initial_state(0.0), 0.0, 0.0
    samples = []
    for index in range(plant.duration_ns // controller.period_ns + 1):
        motion.advance(index * controller.period_ns)
        samples.append((motion.linear[Y], held_rad))
        measured_m = (
            round(motion.linear[Y] / LATERAL_ERROR_RESOLUTION_M) * LATERAL_ERROR_RESOLUTION_M
        )
        state, output = design.step(design.params, state, LawInput(measured_m, steer_rad))
        low_rad = max(-angle_rad, steer_rad - step_rad)
        high_rad = min(angle_rad, steer_rad + step_rad)
        steer_rad = min(max(output.steer_rad, low_rad), high_rad)
        held_rad = round(steer_rad / STEER_RESOLUTION_RAD) * STEER_RESOLUTION_RAD
        motion.command(held_rad)
    return samples[1:]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("family", "period_ms"), [("practical", 10.0), ("paper", 1.0)])
def test_without_latency_the_loop_is_the_textbook_s_bit_for_bit(
    law: str, family: str, period_ms: float
) -> None:
    controller = preset(f"{family}_{law}", "followed_point=preview")
    plant = plant_settings(300 * period_ms * 1e-3, sensor_period_ms=period_ms)
    result = run(plant, controller)
    node_loop = [(sample.lateral_error_m, sample.command_rad) for sample in result.plant.samples]
    assert len(node_loop) == 300
    assert node_loop == textbook_loop(plant, controller)


JITTER = LatencySettings(model=Distribution.GAMMA, mean_s=0.04, spread_s=0.02, loss=0.02)


def candump(path: Path, seed: int) -> bytes:
    plant = plant_settings(2.0, downlink=JITTER, uplink=JITTER, seed=seed)
    run_virtual_pair(plant, preset("practical_pd_ddob"), candump_log=path)
    return path.read_bytes()


def test_the_same_seed_gives_the_same_log_byte_for_byte(tmp_path: Path) -> None:
    first = candump(tmp_path / "first.log", seed=7)
    assert len(first.splitlines()) > 500
    assert candump(tmp_path / "second.log", seed=7) == first
    assert candump(tmp_path / "third.log", seed=8) != first


def first_echoes(result: Run) -> dict[int, tuple[int, int]]:
    """When each command was sent, and when its counter first came back [ns], by counter."""
    sent_ns = {command.command_counter: at_ns for at_ns, command in result.commands}
    echoes: dict[int, tuple[int, int]] = {}
    for at_ns, said in result.heard:
        if isinstance(said, SteeringStatus) and said.status is not SteeringStatusCode.NO_COMMAND:
            counter = said.applied_counter
            echoes.setdefault(counter, (sent_ns[counter], at_ns))
    return echoes


latencies_ns = st.integers(0, 300 * MS_NS)


@given(downlink_ns=latencies_ns, uplink_ns=latencies_ns)
@example(downlink_ns=0, uplink_ns=0)
@example(downlink_ns=80 * MS_NS, uplink_ns=0)
@example(downlink_ns=80 * MS_NS + 1, uplink_ns=20 * MS_NS - 1)
@settings(deadline=None, max_examples=20)
def test_the_round_trip_is_the_latency_and_the_wait_for_the_next_status(
    downlink_ns: int, uplink_ns: int
) -> None:
    result = run(
        plant_settings(
            1.0,
            LatencySettings(mean_s=downlink_ns / S_NS),
            LatencySettings(mean_s=uplink_ns / S_NS),
        ),
        preset("practical_pd"),
    )
    round_trips_ns = {echoed_ns - sent_ns for sent_ns, echoed_ns in first_echoes(result).values()}
    # Without latency a command comes just after a sample, and waits for the next a whole period.
    wait_ns = -downlink_ns % PERIOD_NS if downlink_ns > 0 else PERIOD_NS
    assert round_trips_ns == {downlink_ns + wait_ns + uplink_ns}
    measured = result.controller.report()["round_trip"]
    assert measured["p50_s"] == pytest.approx(round_trips_ns.pop() / S_NS, rel=0.01)


@pytest.mark.parametrize("order", list(Order))
def test_under_jitter_every_command_s_round_trip_is_its_own_latency_and_at_most_a_period(
    order: Order,
) -> None:
    uplink_ns = 33 * MS_NS
    downlink = LatencySettings(
        model=Distribution.NORMAL, mean_s=0.08, spread_s=0.03, loss=0.05, order=order
    )
    result = run(
        plant_settings(5.0, downlink, LatencySettings(mean_s=uplink_ns / S_NS)),
        preset("practical_pd_ddob"),
    )
    # The plant takes down the latency of the command in effect with every sample, and the status
    # of that same instant carries the command's counter.
    motion_start_ns = result.commands[0][0]
    latency_ns = {
        motion_start_ns + round(sample.time_s * S_NS): round(sample.downlink_latency_s * S_NS)
        for sample in result.plant.samples
        if sample.downlink_latency_s >= 0.0
    }
    echoes = first_echoes(result)
    assert len(echoes) > 150
    for sent_ns, echoed_ns in echoes.values():
        applied_at_ns = echoed_ns - uplink_ns
        wait_ns = applied_at_ns - sent_ns - latency_ns[applied_at_ns]
        assert 0 <= wait_ns <= PERIOD_NS


def test_a_bus_of_500_kbit_s_carries_the_loop_at_1_khz() -> None:
    """Three messages each millisecond are most of what such a bus can carry, but not all."""
    bus = BusModel(500_000)
    plant = plant_settings(1.0, sensor_period_ms=1.0)
    controller = preset("paper_pd")
    result = run(plant, controller, bus)
    load = bus.load
    assert load.refused == 0
    assert 0.6 < load.busy_ns / plant.duration_ns < 0.9
    # All that is sent within a period is through before the next one.
    assert result.controller.report()["round_trip"]["max_s"] < 2.1e-3
    assert result.controller.report()["lost"] == result.plant.report()["lost_on_the_bus"] == 0
    assert result.rms_m == pytest.approx(run(plant, controller).rms_m, rel=0.01)
