"""Parts of another package: they act as ours do, everywhere, and fail in one line."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import Field

from examples.own_car import STABLE, Params
from steer_by_wire import (
    CarInput,
    CarModel,
    CarState,
    PathModel,
    Run,
    Settings,
    SettingsError,
    VehicleModel,
    VehicleState,
    car_step,
    path_of_curvature,
    path_through,
    run_study,
    simulate,
)
from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import VehicleInput
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.runtime.settings.toml_text import dump_toml
from tests.support.programs.running_program import running


class Bend(Settings):
    curvature_1_m: float = Field(0.02, ge=-0.1, le=0.1)


class Needed(Settings):
    curvature_1_m: float = Field(ge=-0.1, le=0.1)


BEND = PathModel(
    lambda own: path_of_curvature([(5.0, 0.0), (8.0, own.curvature_1_m), (11.0, 0.0)]),
    settings=Bend,
)
NEEDY = PathModel(lambda own: path_of_curvature([(5.0, own.curvature_1_m)]), settings=Needed)
SQUARE = PathModel(
    lambda _own: path_through([(0, 0), (30, 0), (30, 30), (0, 30)], closed=True), settings=None
)
ONE_POINT = PathModel(lambda _own: path_through([(0, 0)]))
POINTS = PathModel(lambda _own: [(0, 0), (1, 0)])


def single_track(
    p: VehicleParams, x: VehicleState, u: VehicleInput, _own: Any
) -> tuple[float, ...]:
    a, b = state_matrices(p)
    rates = a @ list(x) + b @ list(u)
    return tuple(rates.tolist())


SAME = VehicleModel(single_track)
SHORT = VehicleModel(lambda _p, x, _u, _own: x[:3])
FALLS = VehicleModel(lambda _p, _x, _u, _own: [0.0, 0.0, 0.0, 1.0 / 0.0])
EXPLODES = VehicleModel(lambda _p, x, _u, _own: [0.0, 0.0, 0.0, 1e300 * (1.0 + abs(x[3]))])


class Other(Params):
    pass


class Faster(Params):
    pass


def faster(p: Params, x: CarState, own: Any, u: CarInput, h_s: float) -> tuple[CarState, Any]:
    after = car_step(p.car, x, u, h_s)
    return after if x.arc_length_m < 1.0 else after._replace(speed_m_s=math.inf), own


NOT_ITS_OWN = CarModel(lambda built_in, _own: built_in, STABLE.start, STABLE.step)
OTHER_START = STABLE._replace(start=lambda p: STABLE.start(p))
ONE_STATE = CarModel(
    lambda built_in, _own: Other(built_in, 0.0, 0.0, 1.0),
    STABLE.start,
    lambda p, x, _own, u, h_s: car_step(p.car, x, u, h_s),  # type: ignore[arg-type, return-value]
)
FAST = CarModel(lambda built_in, _own: Faster(built_in, 0.0, 0.0, 1.0), STABLE.start, faster)

PUSH = [
    {"at_s": 0.5, "steering_offset_rad": 0.02},
    {"at_s": 1.0, "side_force_n": 300.0, "friction": 0.8},
]
PARTS = "tests.plant_emulator.test_plugin_parts"
DOWN = "plant.latency.downlink"
STUDY = f"""
name = "own"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd"]
[base.plant]
duration_s = 0.3
[[factors]]
key = "plant.vehicle.model"
values = ["{PARTS}:SAME"]
"""


def own(table: str, part: str, **others: Any) -> dict[str, Any]:
    keys = {f"{table}.{key.replace('__', '.')}": value for key, value in others.items()}
    return {f"{table}.model": f"{PARTS}:{part}", **keys}


def run(overrides: dict[str, Any], **others: Any) -> Run:
    return simulate(controller="practical_pd", duration_s=2.0, overrides=overrides, **others)


@pytest.mark.parametrize("engine", ["virtual", "compiled"])
def test_a_path_is_followed(engine: Any) -> None:
    bend = {"plant.path.kind": "own", **own("plant.path", "BEND", own__curvature_1_m=0.05)}
    made = run(bend, engine=engine)
    assert np.max(made.plant.curvature_1_m) == 0.0  # 2 s at 5 km/h end before it
    fast = run(bend | {"plant.vehicle.speed_m_s": 20.0 / 3.6}, engine=engine)
    assert np.max(fast.plant.curvature_1_m) == pytest.approx(0.05, rel=0.02)
    assert np.all(np.diff(fast.track().path_x_m) > 0.0)


def test_a_closed_path_through_points_returns() -> None:
    square = {"plant.path.kind": "own", **own("plant.path", "SQUARE")}
    track = run(square | {"plant.vehicle.speed_m_s": 240.0 / 3.6}).track()
    assert np.hypot(track.path_x_m - 30.0, track.path_y_m - 30.0).min() < 0.5
    assert track.path_x_m[-1] < 15.0


def test_the_rig_s_own_equations_put_in_for_it_give_its_motion() -> None:
    """Events of wheel, path and disturbance are all met, and the integration adds nothing."""
    busy = {
        "plant.actuator.lag_s": 0.05,
        "plant.actuator.rate_limit_rad_s": 0.3,
        "plant.vehicle.speed_m_s": 30.0 / 3.6,
        "plant.path": {"kind": "double_lane_change", "start_m": 1.0},
        "plant.disturbance.steps": PUSH,
    }
    exact = run(busy).plant
    integrated = run(busy | own("plant.vehicle", "SAME")).plant
    assert np.ptp(exact.lateral_error_m) > 0.03
    for name in ("lateral_error_m", "heading_error_rad", "yaw_rate_rad_s", "side_slip_rad"):
        np.testing.assert_allclose(
            getattr(integrated, name), getattr(exact, name), rtol=0.0, atol=1e-8, err_msg=name
        )


def test_a_car_with_a_state_of_its_own_gives_the_same_bits_compiled() -> None:
    """Without gain it is the built-in one."""
    road = {"plant.car.friction": 0.3, "plant.path": {"kind": "single_lane_change"}}
    built_in = simulate("large_sedan", "highway_pd", duration_s=4.0, overrides=road)
    for gain in (0.0, 4e4):
        own_car = {"plant.car.model": STABLE, "plant.car.own": {"gain_n_m_s_rad": gain}}
        virtual, compiled = (
            simulate("large_sedan", "highway_pd", duration_s=4.0, overrides=road | own_car,
                     engine=engine)
            for engine in ("virtual", "compiled")
        )  # fmt: skip
        found, wanted = compiled.plant.lateral_error_m, virtual.plant.lateral_error_m
        np.testing.assert_array_equal(found, wanted)
        np.testing.assert_array_equal(compiled.controller.sent_rad, virtual.controller.sent_rad)
        is_same = np.array_equal(virtual.plant.yaw_rate_rad_s, built_in.plant.yaw_rate_rad_s)
        assert is_same == (gain == 0.0)


def test_a_compiled_run_that_fails_names_car_and_law() -> None:
    laws = {"controller.law": "tests.support.nodes.plugin_laws:DIVIDES"}
    line = r"car model examples.own_car:STABLE or law tests.*:DIVIDES raises ZeroDivisionError"
    with pytest.raises(SettingsError, match=line):
        simulate("large_sedan", "highway_pd", duration_s=4.0, engine="compiled",
                 overrides=laws | {"plant.car.model": STABLE})  # fmt: skip


def test_compiled_runs_and_studies_refuse_other_equations(tmp_path: Path) -> None:
    line = r"vehicle\.model = 'tests.*:SAME': compiled runs have"
    with pytest.raises(SettingsError, match=line):
        run(own("plant.vehicle", "SAME"), engine="compiled")
    file = tmp_path / "study.toml"
    file.write_text(STUDY, encoding="utf-8")
    with pytest.raises(SettingsError, match=f"run 0: {line}"):
        run_study(file)


def test_its_settings_are_written_and_read_again(tmp_path: Path) -> None:
    bend = {"plant.path.kind": "own", **own("plant.path", "BEND", own__curvature_1_m=0.05)}
    settings = simulate(duration_s=0.1, overrides=bend).plant_settings
    file = tmp_path / "plant.toml"
    file.write_text(dump_toml(settings), encoding="utf-8")
    assert "[path.own]\ncurvature_1_m = 0.05\n" in dump_toml(settings)
    assert load_settings(PlantSettings, file=file) == settings
    assert hash(load_settings(PlantSettings, file=file)) == hash(settings)


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (
            {f"{DOWN}.model": "gama"},
            'model = "gama" is not a known one (did you mean gamma? allowed: constant,',
        ),
        (
            own("plant.vehicle", "BEND"),
            "is no vehicle model but of type PathModel: it has to be a ",
        ),
        (
            {"plant.path": {"kind": "own", "model": f"{PARTS}:NEEDY"}},
            "path: own.curvature_1_m is missing (allowed: number from",
        ),
        (
            {"plant.path": {"kind": "own", "model": f"{PARTS}:BEND", "own": {"curvatur": 1}}},
            "own: curvatur is not a known key (did you mean curvature_1_m?)",
        ),
        ({"plant.vehicle.own.share": 0.5}, "own: model = None has no table of its own"),
        ({"plant.path": {"kind": "own"}}, "path.model is missing"),
        (
            {"plant.path": {"kind": "own", "model": "x"}},
            "there is no path model x; one of your own ",
        ),
        (
            {"plant.path": {"kind": "own", "model": f"{PARTS}:ONE_POINT"}},
            ":ONE_POINT raises ValueError: must hold 2 to 100000 points that lie apart, not 1",
        ),
        (
            {"plant.path": {"kind": "own", "model": f"{PARTS}:POINTS"}},
            ":POINTS gives a list: it has to be what path_through or path_of_curvature give",
        ),
        (own("plant.vehicle", "SHORT"), ":SHORT raises TypeError: "),
        (own("plant.vehicle", "FALLS"), ":FALLS raises ZeroDivisionError: float division by zero"),
        (
            own("plant.vehicle", "SAME") | {"plant.car.friction": 0.5},
            "vehicle.model has the equations of the linear vehicle: with a table [car] name a car",
        ),
        (own("plant.car", "NOT_ITS_OWN"), "params must be a NamedTuple of its own, not CarParams"),
        (own("plant.car", "ONE_STATE"), ":ONE_STATE: a step must return a CarState, and a state "),
        (own("plant.car", "FAST"), ":FAST: speed_m_s = inf is not a finite number"),
    ],
)
def test_what_is_wrong_with_it_is_said_in_one_line(overrides: dict[str, Any], line: str) -> None:
    with pytest.raises(SettingsError) as refused:
        run(overrides)
    assert line in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_two_cars_of_one_kind_of_params_are_refused() -> None:
    # Runs know a car by the type of its params: the second would start as the first.
    run(own("plant.car", "STABLE"))
    with pytest.raises(SettingsError, match=":OTHER_START: params must be a NamedTuple of its own"):
        run(own("plant.car", "OTHER_START"))


def test_a_vehicle_that_grows_without_bound_ends_the_run_safely() -> None:
    made = run(own("plant.vehicle", "EXPLODES"))
    assert made.outcome == made.plant_report["failure"] != ""
    assert np.isfinite(made.plant.lateral_error_m).all()


def test_one_that_fails_on_a_bus_leaves_a_report_and_one_line(tmp_path: Path) -> None:
    report = tmp_path / "plant.json"
    sets = ("--set", f"vehicle.model={PARTS}:FALLS", "--set", "start_on_first_command=false")
    with launched_broker() as address:
        bus = ("-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={address}")
        with running("steer_by_wire.plant_emulator", [*bus, *sets], report) as plant:
            assert plant.end() == ExitStatus.SETTINGS
            errors = [line for line in plant.printed if "error:" in line]
            assert len(errors) == 1
            assert f"vehicle model {PARTS}:FALLS raises ZeroDivisionError" in errors[0]
            assert errors[0].endswith(plant.report()["ended_by"])
