"""Identification of drawn cars, whose truth is known."""

import re
import tomllib
from functools import cache

import numpy as np
import pytest
from scipy.signal import lsim

from steer_by_wire.closed_loop.identification.figures import DELAYS, Verdict, figures_of, half_of
from steer_by_wire.closed_loop.identification.fit import long_run_sums
from steer_by_wire.closed_loop.identification.identified import (
    Identification,
    doubts_about,
    identify,
    predict,
)
from steer_by_wire.closed_loop.identification.parameters import Known, car_tables
from steer_by_wire.closed_loop.identification.response import LANES, STEP_S, Grid, coarse, respond
from steer_by_wire.closed_loop.identification.time_series import Channel, Quantity, make_drive
from steer_by_wire.closed_loop.identification.vehicle_file import (
    figure_line,
    read_vehicle,
    vehicle_toml,
)
from steer_by_wire.plant_emulator.vehicle.car.car_design import car_params
from steer_by_wire.plant_emulator.vehicle.car.car_step import CarInput, CarState, car_step
from steer_by_wire.runtime.settings import SettingsError
from tests.searches.foreign_plant import identified_car, understeer_rad_s2_m
from tests.searches.hidden_cars import EXPECTED, OFFSET, one_car
from tests.support.runs.drawn_drives import DrawnDrive, drawn_car, log_of, prescribed

SEED = 3
SIDE = "lateral_acceleration_m_s2"


@cache
def drawn() -> DrawnDrive:
    rng = np.random.default_rng(SEED)
    car = drawn_car(rng)
    steering, speed = (one[4_000:30_000] for one in prescribed(car))
    return log_of(car, 1.7 * steering, speed, rng, delays_s={SIDE: 0.037})


@cache
def found() -> Identification:
    one = drawn()
    return identify(make_drive(one.channels, "drawn"), one.known)


@pytest.mark.parametrize("tyre", ["fiala", "magic_formula"])
def test_each_of_several_cars_has_the_bits_of_its_own(tyre: str) -> None:
    """They slide, stop and stand; those without lag are computed in plain Python, too."""
    rng, known, time_s = np.random.default_rng(1), Known(tyre=tyre), STEP_S * np.arange(500)
    speed = np.concatenate((np.linspace(0, 9, 100), np.linspace(20, -5, 400).clip(0.0)))
    inputs = 20.0 * rng.uniform(-1.0, 1.0, 500), speed, np.gradient(speed, STEP_S)
    starts, rates = np.array([0, 100, 500]), np.array([0.1, -0.1])
    every = tuple(Channel(one, one, time_s, time_s) for one in (Quantity.YAW_RATE, Quantity(SIDE)))
    grid = Grid(every, STEP_S, starts, rates, time_s, *inputs, np.empty((0, 500)))
    wide = coarse(grid._replace(steering_rad=time_s + STEP_S))
    np.testing.assert_allclose(wide.steering_rad, wide.time_s + wide.step_s)
    late = [drawn_car(rng) for _ in range(LANES + 3)]
    for car, shown in zip(late, respond(grid, late, known), strict=True):
        np.testing.assert_array_equal(shown, respond(grid, [car], known)[0])
    cars = [car | {"lag_squared_s2": 0.0, "delay_and_lag_s": 0.0} for car in late]
    for car, (rate, side) in zip(cars, respond(grid, cars, known), strict=True):
        p, ratio = car_params(*car_tables(car, known)), car["steering_ratio"]
        for step, (steering_rad, u, driven_m_s2) in enumerate(zip(*inputs, strict=True)):
            if step in starts:
                x = CarState(u, 0.0, rates[step // 100], *[0.0] * 9)
            _, v, r, *_, force_n, _, _, _, _ = x
            assert rate[step] == r + car["yaw_rate_offset_rad_s"]
            wheel_rad = steering_rad * (1.0 / ratio) + car["steering_offset_rad"] / ratio
            bends_m_s2 = force_n * wheel_rad * p.mass_1_kg - v * r
            acts = CarInput(wheel_rad, driven_m_s2 + bends_m_s2, 0.0, 0.0, 1.0, 0.0)
            x = car_step(p, x._replace(speed_m_s=u), acts, STEP_S)
            assert side[step] == car[f"{SIDE}:gain"] * x.lateral_m_s2 + car[f"{SIDE}:offset"]


@pytest.mark.parametrize("seed", range(3))
def test_intervals_of_a_hidden_car_hold_the_truth(seed: int) -> None:
    """Known, unknown, in traffic; figures depend on each other, so several may miss together."""
    row = one_car(seed)
    figures = row["figures"].values()
    outside = sum(not one["low"] <= one["truth"] <= one["high"] for one in figures)
    assert outside <= len(figures) // 4
    if row["prescribed"]:
        assert {row["figures"][name]["verdict"] for name in EXPECTED} == {Verdict.IDENTIFIED}
        late = row["figures"][OFFSET]
        assert late["value"] == pytest.approx(late["truth"], abs=0.002)


@pytest.mark.parametrize("lags", [0, 3, 499])
def test_scores_are_summed_over_lags_by_bartletts_weights(lags: int) -> None:
    scores = np.cumsum(np.random.default_rng(1).standard_normal((500, 3)), axis=0)
    wanted = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        wanted += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    np.testing.assert_allclose(long_run_sums(scores, lags), wanted, rtol=1e-12)


def test_an_identified_car_shows_its_understeer_in_a_steady_bend() -> None:
    one, fit = {figure.name: figure.value for figure in found().figures}, found().fit
    x = fit.x.copy()
    x[fit.problem.place("drive_front")] = 0.0  # In front the driving force turns the car, too.
    rear_driven = identified_car(found()._replace(fit=fit._replace(x=x)))
    measured = understeer_rad_s2_m(rear_driven, drawn().truth["wheelbase_m"], 0.1)
    assert measured == pytest.approx(one["understeer_gradient_rad_s2_m"], rel=0.02)


def test_no_dead_time_is_below_zero() -> None:
    """Of a yaw rate whose clock is early the sum is, which is said, but not its parts."""
    wheel, speed, rate, _ = drawn().channels
    early = rate._replace(time_s=rate.time_s - 0.3)
    found = identify(make_drive([wheel, speed, early], "early"), drawn().known)
    figures = {one.name: one for one in found.figures}
    assert figures["delay_and_lag_s"].high < 0.0
    assert "before the wheel's angle has an effect" in found.notes[-1]
    x = found.fit.x.copy()
    x[found.fit.problem.place("lag_squared_s2")] = 0.0
    without_lag = {one.name: one for one in figures_of(found.fit._replace(x=x), None)}
    assert figures["dead_time_s"][2:5] == without_lag["dead_time_s"][2:5] == (0.0, 0.0, 0.0)
    assert figure_line(figures["dead_time_s"]).startswith("dead_time_s at most 0 s")


def test_of_a_neutral_bus_is_told_its_understeer_not_its_load() -> None:
    truth = drawn().truth
    bus = truth | {"wheelbase_m": 6.0, "front_share": 0.62, "rear_c": truth["front_c"]}
    driven = (one[4_000:30_000] for one in prescribed(bus))
    log = log_of(bus, *driven, np.random.default_rng(1))
    known = log.known.model_copy(update={"front_axle_distance_m": None})
    _, (_, front, *_), (*_, note) = identify(make_drive(log.channels[:3], "neutral"), known)
    low, high = re.search(r"nearly neutral: .* adds \S+ % \[(.*), (.*)\]", note).groups()
    assert -2.5 < float(low) < 0.0 < float(high) < 2.5
    assert not any(note.startswith("nearly neutral") for note in found().notes)
    assert front.low < 0.38 * 9.80665 * bus["front_c"] < front.high


def test_a_wheel_that_is_repeated_in_five_rows_delays_nothing() -> None:
    """Half a period, 20 ms, would be missing."""
    wheel, *others = drawn().channels
    held = wheel._replace(values=np.repeat(wheel.values[::5], 5)[: len(wheel.values)])
    figures = identify(make_drive([held, *others], "held"), drawn().known).figures
    (total,) = (one for one in figures if one.name == "delay_and_lag_s")
    assert total.low < drawn().truth["delay_and_lag_s"] < total.high < total.low + 0.02


def test_an_estimate_is_told_and_written_within_its_own_interval() -> None:
    """Noise may make a delay of next to nothing negative."""
    one, x = found().fit, found().fit.x.copy()
    x[one.problem.place("delay_and_lag_s")] = -0.1 * half_of(one, "delay_and_lag_s")
    figures = figures_of(one._replace(x=x), None)
    assert all(it.low <= it.value <= it.high for it in figures)
    written = tomllib.loads(vehicle_toml(one._replace(x=x), figures, 16.7, "a test"))
    assert written["identified"]["delay_and_lag_s"] == 0.0
    _, car = car_tables(one.values, one.problem.known)
    assert written["car"]["drag_n_s2_m2"] == pytest.approx(car.drag_n_s2_m2)


@pytest.mark.parametrize(("beyond", "wider"), [(-4, 1), (-1, 1), (0, 1), (1, 1), (4, 1), (-1, 100)])
def test_the_parts_of_a_delay_are_within_the_whole(beyond: int, wider: int) -> None:
    """Noise may make the whole shorter than a part."""
    one, x = found().fit, found().fit.x.copy()
    one = one._replace(covariance=wider**2 * one.covariance)
    shift_s = beyond * half_of(one, "delay_and_lag_s")
    x[one.problem.place("delay_and_lag_s")] = one.values["lag_squared_s2"] ** 0.5 + shift_s
    figures = {it.name: it for it in figures_of(one._replace(x=x), None)}
    total, lag, dead = (figures[name] for name in DELAYS)
    assert lag.low + dead.low <= total.low <= lag.high + dead.high
    assert total.high >= max(lag.high, dead.high)
    assert total.value >= lag.value
    assert (total.verdict is Verdict.IDENTIFIED) == (wider == 1)


def test_errors_of_the_right_model_are_white() -> None:
    ends = {one.what: one.is_passed for one in doubts_about(found().fit)}
    assert ends.keys() >= {"errors are white", "linear tyres: refused"}
    assert all(ends.values())
    wandering = found().fit._replace(errors=tuple(map(np.cumsum, found().fit.errors)))
    assert "not white" in next(it.what for it in doubts_about(wandering) if not it.is_passed)


def test_a_prediction_corrects_a_log_that_comes_later(tmp_path) -> None:
    file = tmp_path / "vehicle.toml"
    file.write_text(vehicle_toml(found().fit, found().figures, 16.7, "a test"))
    drive = make_drive(drawn().channels, "drawn")
    late = drive.outputs[0]._replace(time_s=drive.outputs[0].time_s + 0.04)
    _, notes = predict(drive._replace(outputs=(late,)), *read_vehicle(file))
    assert "comes 40 ms later" in notes[-1]


def test_a_car_steered_at_the_rear_is_refused_in_words() -> None:
    steering = prescribed(drawn().truth)[0][4_000:16_000]
    time_s, u = np.arange(len(steering)) * 0.001, 16.7
    mass, inertia, front_m, rear_m, front, rear = 1500.0, 2400.0, 1.3, 1.4, 90e3, 110e3
    lateral = [-(front + rear) / (mass * u), (rear_m * rear - front_m * front) / (mass * u) - u]
    turning = [(rear_m * rear - front_m * front) / (inertia * u),
               -(front_m**2 * front + rear_m**2 * rear) / (inertia * u)]  # fmt: skip
    inputs = np.array([[rear / mass], [-rear_m * rear / inertia]])
    system = [lateral, turning], inputs, np.eye(2), np.zeros((2, 1))
    _, states, _ = lsim(system, steering / -16.0, time_s)
    side = states @ lateral + u * states[:, 1] + inputs[0, 0] * steering / -16.0
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(time_s[::10]))
    driven = steering, np.full_like(steering, u), states[:, 1], side
    names = (Quantity.HAND_WHEEL, Quantity.SPEED, Quantity.YAW_RATE, Quantity.LATERAL_ACCELERATION)
    channels = [
        Channel(str(name), name, time_s[::10], values[::10] + noise)
        for name, values in zip(names, driven, strict=True)
    ]
    with pytest.raises(SettingsError, match=r"steered at the rear|does not fit"):
        identify(make_drive(channels, "rear"), drawn().known)


def test_motion_of_wrong_sign_or_unit_is_refused_in_words() -> None:
    wheel, speed, rate, side = drawn().channels
    for factor, what in ((-1.0, "against the wheel"), (57.3, "wrong unit"), (0.0175, "in deg ")):
        wrong = rate._replace(values=factor * rate.values)
        with pytest.raises(SettingsError, match=what):
            identify(make_drive([wheel, speed, wrong, side], "drawn"), drawn().known)
    in_g, still = (side._replace(values=factor * side.values) for factor in (0.102, 0.0))
    with pytest.raises(SettingsError, match=r"is some 0\.\d+ times speed times yaw rate"):
        identify(make_drive([wheel, speed, rate, in_g], "drawn"), drawn().known)
    assert make_drive([wheel, speed, rate, still], "drawn").notes[-1].endswith("left out")
    empty = side._replace(time_s=side.time_s[:0], values=side.values[:0])
    assert not make_drive([wheel, speed, rate, empty], "drawn").notes
