"""Cars that nobody here made up: the package opendbc reads and drives ours as the car it knows.

It is in the extra ``dev`` (Python below 3.13); without it all tests here are skipped.
"""

import math
import shutil
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import (
    make_virtual_pair,
    make_virtual_plant,
    run_virtual_nodes,
)
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import Dialect, read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.dbc.messages import Decoded, LateralError, decode
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from steer_by_wire.plant_emulator.settings import PRESETS, PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.end import End
from steer_by_wire.runtime.settings import load_settings, read_preset
from tests.support.frames.made_messages import error_of

opendbc: Any = pytest.importorskip("opendbc", reason="no opendbc: no car of others was driven")

DIALECTS = Path(__file__).parents[3] / "examples" / "dialects"
MOTION_S, FRAMES = 4.0, 300
STEP_NS, SEEN_NS = 10_000_000, 1_100_000_000
SETTLED = 200
SPEED_M_S = 12.5  # of highway_nominal


class Car(NamedTuple):
    """A car of opendbc.

    ``messages``   that its reader waits for
    ``angle_deg``  by which a hand wheel's angle may differ: half of what the signal resolves
    ``held``       samples for which a frame's angle stands until the next frame
    ``command``    identifier of the command
    ``camera``     identifiers on bus 2, behind which openpilot sits; the others are on bus 0
    """

    fingerprint: str
    database: str
    messages: int
    steering_ratio: float
    angle_deg: float
    held: int
    camera: frozenset[int]
    command: int


CARS = {
    "nissan_leaf": Car(
        *("NISSAN_LEAF", "nissan_leaf_2018_generated", 16, 17.0, 0.051, 0),
        *(frozenset({0x2B1, 0x4CC, 0x4CB, 0x30F}), 0x169),
    ),
    "tesla_model_3": Car(
        *("TESLA_MODEL_3", "tesla_model3_party", 11, 12.0, 0.051, 0),
        *(frozenset({0x129, 0x39B, 0x2B9, 0x488}), 0x488),
    ),
    # Its angle is one without an origin, corrected by the mean distance from a coarse one.
    "toyota_rav4_2023": Car(
        *("TOYOTA_RAV4_TSS2_2023", "toyota_nodsu_pt_generated", 19, 14.3, 1.5, 2),
        *(frozenset({0x412}), 0x191),
    ),
}


@cache
def dialect_of(name: str, folder: Path) -> Dialect:
    """Return a shipped mapping beside the database that it names."""
    database = CARS[name].database
    generated = opendbc.get_generated_dbcs().get(database)
    if generated is None:
        shutil.copy(Path(opendbc.DBC_PATH) / f"{database}.dbc", folder)
    else:
        # It says 8 bytes; the safety code of the same package waits for 4.
        as_sent = generated.replace("BO_ 460 BRAKE_PEDAL: 8", "BO_ 460 BRAKE_PEDAL: 4")
        (folder / f"{database}.dbc").write_text(as_sent, encoding="utf-8")
    return read_dialect(Path(shutil.copy(DIALECTS / f"{name}.toml", folder)))


class Reading(NamedTuple):
    """What the car's own reader makes of the frames of a run, every 10 ms.

    ``first``  which of its states is that of the first sample
    """

    states: list[Any]
    invalid: list[int]
    messages: int
    first: int
    wheel_rad: list[float]


def interface_of(car: Car) -> Any:
    """Return what openpilot drives a car by: its CarState and its CarController."""
    interface = import_module("opendbc.car.car_helpers").interfaces[car.fingerprint]
    fingerprint = import_module("opendbc.car").gen_empty_fingerprint()
    params = interface.get_params(car.fingerprint, fingerprint, [], False, False, False)
    return interface(params)


def read_by_the_car(name: str, folder: Path) -> Reading:
    """Drive our pair for MOTION_S in the dialect, and hand all its frames to the car's reader."""
    car = CARS[name]
    reader = interface_of(car)
    frames: list[tuple[int, Frame]] = []

    def on_wire(time_ns: int, _sender: int, frame: Frame) -> None:
        frames.append((time_ns, frame))

    dialect = dialect_of(name, folder)
    plant = load_settings(
        PlantSettings, read_preset(PRESETS, "highway_nominal"), None, [f"duration_s={MOTION_S}"]
    )
    pair = make_virtual_pair(plant, controller_preset("highway_pd_ddob"))
    nodes: tuple[Any, Any] = (
        Gateway(pair.edge, dialect, End.PLANT, 0),
        Gateway(pair.controller, dialect, End.CONTROLLER, 0),
    )
    run_virtual_nodes(*nodes, BusModel(500_000), None, lambda: False, on_wire)
    assert [node.report()["dialect"]["refused"] for node in nodes] == [{}, {}]

    states, invalid, next_frame = [], [], 0
    for now_ns in range(STEP_NS, frames[-1][0], STEP_NS):
        come = []
        while frames[next_frame][0] < now_ns:
            can_id, data, _ = frames[next_frame][1]
            come.append((can_id, data, 2 if can_id in car.camera else 0))
            next_frame += 1
        states.append(reader.update([(SEEN_NS + now_ns, come)]))
        if not states[-1].canValid:
            invalid.append(now_ns)
    parsers = reader.can_parsers.values()
    count = sum(len(parser.message_states) for parser in parsers)
    samples, start_s = pair.plant.samples, 1e-9 * pair.plant.motion_start_ns
    first = round(100.0 * (start_s + samples[0].time_s))
    return Reading(states, invalid, count, first, [one.wheel_angle_rad for one in samples])


class Follower:
    """The car's own CarController behind a path follower: P, I, and the heading."""

    deadline_ns, finished = 0, False

    def __init__(self, car: Car) -> None:
        self._car, self._interface = car, interface_of(car)
        self._structs = import_module("opendbc.car").structs
        self._come: list[tuple[int, bytes, int]] = []
        self._error = error_of()
        self._integral_rad = 0.0

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        can_id, data, _ = frame
        bus = 2 if can_id in self._car.camera else 0
        self._come.append((can_id, data, bus))
        decoded = decode(frame)
        if isinstance(decoded, Decoded) and isinstance(decoded.message, LateralError):
            self._error = decoded.message
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self.deadline_ns += STEP_NS
        state = self._interface.update([(SEEN_NS + now_ns, self._come)])
        error_m, heading_rad = self._error
        self._integral_rad += 1e-9 * STEP_NS * 0.02 * error_m
        steer_rad = -0.02 * error_m - 0.3 * heading_rad - self._integral_rad
        control = self._structs.CarControl()
        control.enabled = control.latActive = state.canValid and state.cruiseState.enabled
        control.actuators.steeringAngleDeg = self._car.steering_ratio * math.degrees(steer_rad)
        _, sent = self._interface.apply(control.as_reader(), SEEN_NS + now_ns)
        commands = [bytes(data) for can_id, data, _ in sent if can_id == self._car.command]
        # On the camera's bus the car's own assistant is heard: here it is this one.
        self._come = [(self._car.command, data, 2) for data in commands]
        return [Frame(self._car.command, data, 0) for data in commands]


@pytest.mark.parametrize("name", CARS)
def test_the_car_s_own_reader_finds_our_car_valid(name: str, tmp_path: Path) -> None:
    reading = read_by_the_car(name, tmp_path)
    assert len(reading.states) > 100 * MOTION_S - 10
    # It asks for a message from when it has first looked for it: each has come once by then.
    assert max(reading.invalid) < SEEN_NS
    assert reading.messages == CARS[name].messages
    settled = reading.states[SETTLED:]
    assert all(state.vEgo == pytest.approx(SPEED_M_S, abs=0.05) for state in settled)
    assert all(state.cruiseState.enabled and not state.standstill for state in settled)
    angles_deg = [state.steeringAngleDeg for state in settled]
    assert max(map(abs, angles_deg)) > 2.0
    car = CARS[name]
    wheel_deg = [car.steering_ratio * math.degrees(angle_rad) for angle_rad in reading.wheel_rad]
    for step, angle_deg in enumerate(angles_deg, SETTLED - reading.first):
        held_deg = wheel_deg[step - car.held : step + 1]
        assert min(abs(angle_deg - one) for one in held_deg) <= car.angle_deg
    assert not any(state.steerFaultTemporary or state.steerFaultPermanent for state in settled)


@pytest.mark.parametrize("name", CARS)
def test_the_car_s_own_controller_holds_the_path_at_60_km_h(name: str, tmp_path: Path) -> None:
    overrides = [
        f"duration_s={MOTION_S}",
        "vehicle.speed_m_s=16.667",
        "vehicle.preview_distance_m=10.0",
        "verdict.judged_point=preview",  # the point that the follower holds
        "path={kind='ellipse',semi_major_axis_m=400.0,semi_minor_axis_m=300.0}",
    ]
    settings = load_settings(
        PlantSettings, read_preset(PRESETS, "highway_nominal"), None, overrides
    )
    plant, edge = make_virtual_plant(settings)
    gateway = Gateway(edge, dialect_of(name, tmp_path), End.PLANT, 0)
    seconds = iter(range(round(MOTION_S) + 2))
    bus = BusModel(500_000)
    run_virtual_nodes(gateway, Follower(CARS[name]), bus, None, lambda: next(seconds, None) is None)
    assert plant.finished
    report = gateway.report()
    assert report["dialect"]["refused"] == {"not engaged": 1}  # before it has seen every message
    assert report["dialect"]["accepted"] >= MOTION_S * 50
    assert verdict_text(report).startswith("holds: ")
    assert 0.005 < report["wheel_angle_peak_rad"] < 0.1
