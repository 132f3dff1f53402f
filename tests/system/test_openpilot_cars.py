"""Cars that nobody here made up: the package opendbc reads ours as the car that it knows.

``pip install opendbc==0.3.1 pycapnp==2.1.0 pycryptodome`` (Python below 3.13); without it all tests
here are skipped.
"""

import math
import shutil
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import Dialect, read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.dbc.dialect.settings import CONTROLLER, PLANT
from steer_by_wire.plant_emulator.settings import PRESETS, PlantSettings
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.settings import load_settings, read_preset

opendbc: Any = pytest.importorskip("opendbc", reason="no opendbc: no car of others was driven")

DIALECTS = Path(__file__).parents[2] / "examples" / "dialects"
MOTION_S, STEP_NS, SEEN_NS = 60.0, 10_000_000, 1_100_000_000
SETTLED = 200
SPEED_M_S = 12.5  # of highway_nominal


class Car(NamedTuple):
    """A car of opendbc.

    ``messages``   that its reader waits for
    ``angle_deg``  by which a hand wheel's angle may differ: half of what the signal resolves
    ``held``       samples for which a frame's angle stands until the next frame
    ``camera``     identifiers on bus 2, behind which openpilot sits; the others are on bus 0
    """

    fingerprint: str
    database: str
    messages: int
    steering_ratio: float
    angle_deg: float
    held: int
    camera: frozenset[int]


CARS = {
    "nissan_leaf": Car(
        *("NISSAN_LEAF", "nissan_leaf_2018_generated", 16, 17.0, 0.051, 0),
        frozenset({0x2B1, 0x4CC, 0x4CB, 0x30F}),
    ),
    "tesla_model_3": Car(
        *("TESLA_MODEL_3", "tesla_model3_party", 11, 12.0, 0.051, 0),
        frozenset({0x129, 0x39B, 0x2B9, 0x488}),
    ),
    # Its angle is one without an origin, corrected by the mean distance from a coarse one.
    "toyota_rav4_2023": Car(
        *("TOYOTA_RAV4_TSS2_2023", "toyota_nodsu_pt_generated", 19, 14.3, 1.5, 2),
        frozenset({0x412}),
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
        (folder / f"{database}.dbc").write_text(generated, encoding="utf-8")
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


def read_by_the_car(name: str, folder: Path) -> Reading:
    """Drive our pair for a minute in the dialect, and hand all its frames to the car's reader."""
    car = CARS[name]
    interface = import_module("opendbc.car.car_helpers").interfaces[car.fingerprint]
    fingerprint = import_module("opendbc.car").gen_empty_fingerprint()
    params = interface.get_params(car.fingerprint, fingerprint, [], False, False, False)
    reader = interface(params)
    frames: list[tuple[int, Frame]] = []

    def on_wire(time_ns: int, _sender: int, frame: Frame) -> None:
        frames.append((time_ns, frame))

    dialect = dialect_of(name, folder)
    plant = load_settings(
        PlantSettings, read_preset(PRESETS, "highway_nominal"), None, [f"duration_s={MOTION_S}"]
    )
    pair = make_virtual_pair(plant, controller_preset("highway_pd_ddob"))
    nodes: tuple[Any, Any] = (
        Gateway(pair.edge, dialect, PLANT, 0),
        Gateway(pair.controller, dialect, CONTROLLER, 0),
    )
    run_virtual_nodes(*nodes, QuietBus(500_000), None, lambda: False, on_wire)
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


@pytest.mark.parametrize("name", CARS)
def test_the_car_s_own_reader_finds_our_car_valid_for_a_minute(name: str, tmp_path: Path) -> None:
    reading = read_by_the_car(name, tmp_path)
    assert len(reading.states) > 5990
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
