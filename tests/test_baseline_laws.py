"""Smith predictor, delayed set point and feed-forward of the curve: each against another form."""

import math
import re
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from controller.analysis.check import check_text
from controller.analysis.linear_system import NotLinearError, law_system
from controller.analysis.sampled_loop import SampledLoop
from controller.analysis.stable_delays import stable_delays
from controller.baseline_design import steady_steer
from controller.delayed_set_point import REQUESTS, request_before
from controller.design import LawDesign, design_law
from controller.fading import NO_STEER
from controller.feed_forward import curve_steer
from controller.law_interface import NO_HISTORY, NO_LINK, LawInput, Link, VehicleReading
from controller.law_settings import VehicleModelSettings
from controller.node import ControllerNode, ControlSample
from controller.settings import ControllerSettings
from plant_emulator.node import PlantNode
from plant_emulator.settings import PlantSettings
from plant_emulator.vehicle import VehicleParams, state_matrices
from runtime.settings import SettingsError, load_settings, read_preset
from tests.test_batch import NETWORKS, assert_same_as_nodes
from tests.test_batch import controller_settings as preset
from tests.test_batch import plant_settings as rig
from tests.test_laws import transition
from tools.batch.engine import Outcome, run_batch
from tools.virtual_pair import run_virtual_nodes

PERIOD_NS, PERIOD_S = 10_000_000, 0.01
FEED_FORWARD = ("feed_forward={}",)
SMITH = ('law="smith"', "smith={delay_s=0.16}")
SET_POINT = (
    'law="delayed_set_point"',
    "delayed_set_point={delay_s=0.1, proportional_gain=0.3, integral_gain_1_s=0.5}",
)
ELLIPSE = ('path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}',)
CIRCLE = ('path={kind="circle", radius_m=30.0}',)


def run_nodes(plant: PlantSettings, settings: ControllerSettings) -> ControllerNode:
    """The controller's node after a run in virtual time, its ticks kept."""
    node = ControllerNode(settings, 0, samples_max=1_000_000)
    run_virtual_nodes(PlantNode(plant, 0), node, None, None, lambda: False)
    return node


# Compiled runs


@pytest.mark.parametrize(
    ("name", "overrides", "network"),
    [
        *product(
            ("practical_smith", "practical_delayed_set_point"),
            ((),),
            ("off the grid", "as it arrives", "schedule"),
        ),
        *product(("practical_smith", "practical_pd_ddob"), (FEED_FORWARD,), ("as it arrives",)),
        ("practical_delayed_set_point", (), "bursts"),
    ],
)
def test_a_compiled_run_equals_the_nodes(name: str, overrides: Sequence[str], network: str) -> None:
    latency = [f"latency.{override}" for override in NETWORKS[network]]
    run = assert_same_as_nodes(rig([*ELLIPSE, *latency], 4.0), preset(name, overrides))
    assert len(run.tick_s) > 300


# Smith predictor


def sent_history(sent_rad: Sequence[float], error_m: float) -> LawInput:
    """What a law is told that has sent these commands, the newest last."""
    history = NO_HISTORY._replace(tick_mask=-1, sent_rad=sent_rad)
    newest_rad = sent_rad[-1] if sent_rad else 0.0
    return LawInput(error_m, newest_rad, link=NO_LINK._replace(tick=len(sent_rad)), history=history)


def after_a_pulse(delay: int, model_delay_s: float) -> tuple[NDArray[np.float64], ...]:
    """The error that a Smith predictor shows, and the one there would be without delay."""
    settings = preset("practical_pd", ('law="smith"', f"smith={{delay_s={model_delay_s}}}"))
    design, phi = design_law(settings), transition(5.0, 2000.0)
    pulse = [0.1 if 20 <= k < 120 else 0.0 for k in range(180)]
    delayed, undelayed, state = np.zeros(6), np.zeros(6), design.initial_state(0.0)
    shown_m, undelayed_m = [], []
    for k, steer_rad in enumerate(pulse):
        seen = sent_history(pulse[:k], float(delayed[3]))
        state, output = design.step(design.params, state, seen)
        shown_m.append(output.compensated_lateral_error_m)
        undelayed_m.append(undelayed[3])
        delayed[4], undelayed[4] = pulse[k - delay] if k >= delay else 0.0, steer_rad
        delayed[:4], undelayed[:4] = phi @ delayed, phi @ undelayed
    return np.array(shown_m), np.array(undelayed_m)


def test_with_the_right_delay_the_smith_predictor_shows_the_error_without_it() -> None:
    """But for half a period: the filter takes a held command to rise over its period."""
    shown_m, undelayed_m = after_a_pulse(16, 0.16)
    halfway_m = 0.5 * (undelayed_m[1:] + undelayed_m[:-1])
    assert np.abs(shown_m[1:] - halfway_m).max() < 1e-3 * undelayed_m.max()


@pytest.mark.parametrize("model_delay_s", [0.1, 0.22])
def test_with_a_wrong_delay_it_shows_what_the_vehicle_does_in_between(model_delay_s: float) -> None:
    """At worst 8 % of the way made here, for 60 ms."""
    shown_m, undelayed_m = after_a_pulse(16, model_delay_s)
    ticks = np.arange(len(shown_m))

    def seen_after(delay_s: float) -> NDArray[np.float64]:
        return np.asarray(np.interp(ticks - delay_s / PERIOD_S, ticks, undelayed_m))

    expected_m = seen_after(0.005) + seen_after(0.16) - seen_after(model_delay_s)
    largest_m = undelayed_m.max()
    assert np.abs(shown_m - expected_m).max() < 1e-3 * largest_m
    assert 0.05 * largest_m < np.abs(shown_m - undelayed_m).max() < 0.1 * largest_m


@pytest.mark.parametrize("delay_s", [0.0, 0.004, 0.0372, 0.16])
def test_the_matrices_of_a_smith_predictor_do_what_its_steps_do(delay_s: float) -> None:
    settings = preset("practical_smith", (f"smith.delay_s={delay_s}",))
    design = design_law(settings)
    system = law_system(design)
    state, x = design.initial_state(0.0), np.zeros(len(system.b))
    sent_rad: list[float] = []
    for error_m in np.random.default_rng(7).normal(0.0, 0.1, 200):
        state, output = design.step(design.params, state, sent_history(sent_rad, float(error_m)))
        sent_rad.append(output.steer_rad)
        assert output.steer_rad == pytest.approx(float(system.c @ x + system.d * error_m), abs=1e-9)
        x = system.a @ x + system.b * error_m


def stable_ms(overrides: Sequence[str]) -> list[tuple[float, float]]:
    settings = preset("practical_pd", overrides)
    assert settings.model is not None
    loop = SampledLoop(design_law(settings), settings.model, PERIOD_NS)
    return [(first / 1e6, last / 1e6) for first, last in stable_delays(loop)]


FAST = (
    "pd.proportional_gain_rad_m=10",
    "pd.derivative_gain_rad_s_m=1.0",
    "pd.derivative_filter_rad_s=50",
)
FAST_SMITH = (*FAST, 'law="smith"', "smith={delay_s=0.3, washout_rad_s=0.2}")


def test_a_fast_smith_predictor_bears_its_own_delay_and_few_others() -> None:
    """Gains that bear 16 ms without it: with it 300 ms, but neither 8 ms more nor less."""
    ((first_ms, last_ms),) = stable_ms(FAST)
    assert first_ms == 0.0
    assert 15.0 < last_ms < 17.0
    ((first_ms, last_ms),) = stable_ms(FAST_SMITH)
    assert 293.0 < first_ms < 295.0
    assert 306.0 < last_ms < 307.0


@pytest.mark.parametrize(("delay_ms", "is_stable"), [(285, False), (300, True), (316, False)])
def test_the_nodes_find_a_smith_predictor_stable_where_the_analysis_does(
    delay_ms: int, is_stable: bool
) -> None:
    """After a push: a hundredth of a millimetre is left, or a limit cycle of most of one."""
    plant = rig(
        [
            *("vehicle.speed_km_h=5", "vehicle.virtual_mass_kg=2000", 'path={kind="straight"}'),
            "disturbance.steps=[{at_s=0.5, side_force_n=100.0}]",
            f"latency.downlink.mean_s={delay_ms * 1e-3}",
        ],
        30.0,
    )
    run = run_batch(plant, preset("practical_pd", FAST_SMITH))
    swing_m = np.std(run.lateral_error_m[2500:])
    assert swing_m < 1e-5 if is_stable else 5e-4 < swing_m < 2e-3


# Feed-forward


def vehicle_of(settings: ControllerSettings) -> VehicleModelSettings:
    assert isinstance(settings.nominal_model, VehicleModelSettings)
    return settings.nominal_model


@pytest.mark.parametrize("speed_m_s", [0.5, 1.4, 8.0, 25.0])
def test_the_feed_forward_is_the_rig_s_steady_state(speed_m_s: float) -> None:
    nominal = vehicle_of(preset("practical_pd"))
    values = nominal.model_dump(exclude={"kind", "speed_m_s"})
    a, b = state_matrices(VehicleParams(speed_m_s, *values.values()))
    # 0 = A (β, r, Δψ, 0) + steer + curvature of 0.01 1/m
    equations = np.column_stack([a[:4, :3], b[:4, 0]])
    *_, steer_rad = np.linalg.solve(equations, -0.01 * b[:4, 1])
    reading = VehicleReading(speed_m_s, 0.0, 0.01)
    assert curve_steer(steady_steer(nominal), reading) == pytest.approx(steer_rad, rel=1e-9)


def on_a_circle(name: str, overrides: Sequence[str], *more: str) -> ControlSample:
    """The last tick after half a minute of the nodes, the nominal vehicle on a circle of 30 m."""
    plant = rig([*CIRCLE, "vehicle.speed_km_h=5", "vehicle.virtual_mass_kg=2000", *more], 30.0)
    return run_nodes(plant, preset(name, overrides)).samples[-1]


@pytest.mark.parametrize("law", ["pd", "pd_dob", "pd_cdob", "pd_ddob", "smith"])
def test_with_feed_forward_every_law_stays_on_a_circle(law: str) -> None:
    last = on_a_circle(f"practical_{law}", FEED_FORWARD, "latency.downlink.mean_s=0.2")
    assert abs(last.lateral_error_m) < 2e-4
    assert abs(last.law_output.disturbance_rad) < 2e-4
    assert last.sent_steer_rad == pytest.approx(2.8461 / 30.0, rel=0.01)


def test_without_it_pd_is_off_the_circle_by_the_steer_over_its_gain() -> None:
    last = on_a_circle("practical_pd", ())
    assert last.lateral_error_m == pytest.approx(-2.85 / 30.0 / 1.52, rel=0.01)


def test_an_observer_that_saw_the_feed_forward_would_take_the_curve_out_twice() -> None:
    """Not so on the way here: in a loop of the test's own, on a circle, with and without."""
    settings = preset("practical_pd_dob", FEED_FORWARD)
    design, phi = design_law(settings), transition(5.0, 2000.0)
    curve = VehicleReading(5.0 / 3.6, 0.0, 0.02)
    for hidden, expected_m in ((True, 0.0), (False, 2.85 * 0.02 / 0.99)):
        x, state, steer_rad = np.zeros(6), design.initial_state(0.0), 0.0
        for _ in range(6000):
            before = state if hidden else state._replace(curve=NO_STEER)
            seen = LawInput(float(x[3]), steer_rad, curve)
            state, output = design.step(design.params, before, seen)
            steer_rad = x[4] = output.steer_rad
            x[5] = 0.02
            x[:4] = phi @ x
        assert x[3] == pytest.approx(expected_m, rel=0.02, abs=1e-4)


def test_the_feed_forward_is_outside_the_loop() -> None:
    for law in ("pd", "pd_dob", "pd_cdob", "pd_ddob", "smith"):
        plain, fed = preset(f"practical_{law}"), preset(f"practical_{law}", FEED_FORWARD)
        assert plain.model is not None
        loops = [SampledLoop(design_law(each), plain.model, PERIOD_NS) for each in (plain, fed)]
        decays = [loop.decay_1_s(180_000_000) for loop in loops]
        assert decays[0] == pytest.approx(decays[1], rel=1e-6)


def test_half_the_feed_forward_is_half_the_steer() -> None:
    nominal = vehicle_of(preset("practical_pd"))
    reading = VehicleReading(2.0, 0.0, -0.03)
    whole_rad = curve_steer(steady_steer(nominal), reading)
    assert curve_steer(steady_steer(nominal, 0.5), reading) == pytest.approx(0.5 * whole_rad)
    assert whole_rad < 0.0


# Delayed set point


def set_point_steps(
    design: LawDesign, inputs: Sequence[tuple[float, VehicleReading]], link: Link = NO_LINK
) -> tuple[Any, list[float]]:
    """State and commands after inputs, every command sent as wanted."""
    state, sent_rad = design.initial_state(0.0), [0.0]
    for error_m, vehicle in inputs:
        seen = LawInput(error_m, sent_rad[-1], vehicle, link)
        state, output = design.step(design.params, state, seen)
        sent_rad.append(output.steer_rad)
    return state, sent_rad[1:]


def a_drive(ticks: int) -> list[tuple[float, VehicleReading]]:
    rng = np.random.default_rng(3)
    return [
        (float(y), VehicleReading(1.5, float(r), float(rho)))
        for y, r, rho in rng.normal(0.0, (0.05, 0.1, 0.02), (ticks, 3))
    ]


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.034, 0.99])
def test_the_set_point_is_the_request_made_one_delay_ago(delay_s: float) -> None:
    settings = preset("practical_pd", (*SET_POINT, f"delayed_set_point.delay_s={delay_s}"))
    design, drive = design_law(settings), a_drive(250)
    _, sent_rad = set_point_steps(design, drive)
    b0, b1, _, a1, _ = design.params.pd.compensator
    per_curvature = 2.8461 + design.params.steady.understeer_s2_m * 1.5**2
    demand_rad, before_m, integral_rad_s, requests_rad_s = 0.0, 0.0, 0.0, [0.0] * 200
    for (y, vehicle), found_rad in zip(drive, sent_rad, strict=True):
        demand_rad, before_m = -(b0 * y + b1 * before_m) - a1 * demand_rad, y
        asked_rad = per_curvature * vehicle.preview_curvature_1_m + demand_rad
        requests_rad_s.append(1.5 * asked_rad / per_curvature)
        places = np.arange(len(requests_rad_s))
        due = np.interp(places[-1] - delay_s / PERIOD_S, places, requests_rad_s)
        error_rad_s = float(due) - vehicle.yaw_rate_rad_s
        integral_rad_s += 0.5 * PERIOD_S * error_rad_s
        correction_rad = per_curvature / 1.5 * (0.3 * error_rad_s + integral_rad_s)
        assert found_rad == pytest.approx(asked_rad + correction_rad, rel=1e-9, abs=1e-12)


def test_a_delay_beyond_what_is_remembered_takes_the_oldest_request() -> None:
    requests_rad_s = tuple(map(float, range(REQUESTS)))
    assert request_before(requests_rad_s, 0.0) == REQUESTS - 1
    assert request_before(requests_rad_s, 2.25) == REQUESTS - 3.25
    assert request_before(requests_rad_s, 1e6) == 0.0
    assert request_before(requests_rad_s, -3.0) == REQUESTS - 1


def test_without_its_inner_loop_it_is_pd_with_feed_forward() -> None:
    table = "delayed_set_point={proportional_gain=0.0, integral_gain_1_s=0.0}"
    alone = preset("practical_pd", ('law="delayed_set_point"', table))
    plant = rig([*ELLIPSE, "latency.downlink.mean_s=0.1"], 5.0)
    runs = [
        run_nodes(plant, settings).samples
        for settings in (alone, preset("practical_pd", FEED_FORWARD))
    ]
    sent_rad = [np.array([tick.sent_steer_rad for tick in ticks]) for ticks in runs]
    np.testing.assert_allclose(sent_rad[0], sent_rad[1], atol=1e-12)


def test_its_integral_takes_out_a_steering_offset_that_pd_with_feed_forward_keeps() -> None:
    offset = "disturbance.steps=[{at_s=1.0, steering_offset_rad=0.02}]"
    kept = on_a_circle("practical_pd", FEED_FORWARD, offset)
    taken = on_a_circle("practical_pd", SET_POINT, offset, "latency.downlink.mean_s=0.1")
    assert kept.lateral_error_m == pytest.approx(0.02 / 1.52, rel=0.02)
    assert abs(taken.lateral_error_m) < 3e-4
    assert taken.law_output.disturbance_rad == pytest.approx(0.02, rel=0.02)


def test_its_integral_waits_while_the_command_is_limited() -> None:
    design = design_law(preset("practical_pd", SET_POINT))
    curve = VehicleReading(1.5, 0.0, 0.05)
    state, output = design.step(design.params, design.initial_state(0.0), LawInput(0.0, 0.0, curve))
    free, _ = design.step(design.params, state, LawInput(0.0, output.steer_rad, curve))
    for _ in range(20):
        state, output = design.step(design.params, state, LawInput(0.0, 0.01, curve))
    assert free.integral_rad_s == 0.0  # the request is not due yet
    assert state.integral_rad_s == 0.0
    state, _ = design.step(design.params, state, LawInput(0.0, output.steer_rad, curve))
    assert state.integral_rad_s > 0.0


def test_its_delay_is_the_echo_s_where_none_is_set() -> None:
    """Tick 50, newest sample 48, a command acts 123 ms after its tick: that of tick 35.7 does."""
    table = "delayed_set_point={proportional_gain=0.3, integral_gain_1_s=0.5}"
    measured = design_law(preset("practical_pd", ('law="delayed_set_point"', table)))
    link = Link(50, 48, 48, 123e6, is_measured=True)
    fixed = ("delayed_set_point.delay_s=0.143",)
    known = design_law(preset("practical_pd", (*SET_POINT, *fixed)))
    drive = a_drive(120)
    found, expected = set_point_steps(measured, drive, link)[1], set_point_steps(known, drive)[1]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_while_the_delay_is_not_known_the_inner_loop_waits() -> None:
    table = "delayed_set_point={proportional_gain=0.3, integral_gain_1_s=0.5}"
    design = design_law(preset("practical_pd", ('law="delayed_set_point"', table)))
    state, sent_rad = set_point_steps(design, a_drive(40))
    fed = design_law(preset("practical_pd", FEED_FORWARD))
    assert state.integral_rad_s == 0.0
    assert sent_rad == pytest.approx(set_point_steps(fed, a_drive(40))[1], abs=1e-12)


def test_at_a_high_rate_it_remembers_a_second_too() -> None:
    settings = preset("practical_pd", (*SET_POINT, "rate_hz=1000", "delayed_set_point.delay_s=0.9"))
    design = design_law(settings)
    still, moving = VehicleReading(1.5, 0.0, 0.0), VehicleReading(1.5, 0.0, 0.05)
    _, sent_rad = set_point_steps(design, [(0.0, moving)] * 1 + [(0.0, still)] * 1000)
    corrections = np.flatnonzero(np.abs(np.diff(sent_rad[2:])) > 1e-9)
    assert 880 < corrections[0] < 920


# Presets


def corner(name: str, delay_ms: int) -> PlantSettings:
    overrides = ["duration_s=60", *ELLIPSE, f"latency.downlink.mean_s={delay_ms * 1e-3}"]
    return load_settings(
        PlantSettings,
        read_preset("plant_emulator.presets", f"paper_corner_{name}"),
        None,
        overrides,
    )


@pytest.mark.parametrize("law", ["smith", "delayed_set_point"])
def test_the_presets_keep_the_error_their_files_state(law: str) -> None:
    name = f"practical_{law}"
    text = read_preset("controller.presets", name).text
    stated = re.search(r"# +RMS error +([\d.]+) m at 0 ms, ([\d.]+) m at 250 ms", text)
    assert stated
    for delay_ms, rms_m in zip((0, 250), map(float, stated.groups()), strict=True):
        runs = [run_batch(corner(each, delay_ms), preset(name)) for each in "abcd"]
        assert {run.outcome for run in runs} == {Outcome.COMPLETE}
        worst_m = max(run.lateral_error_rms_m for run in runs)
        assert worst_m == pytest.approx(rms_m, rel=0.01)


def test_the_smith_preset_is_stable_as_far_as_its_file_states() -> None:
    settings = preset("practical_smith")
    text = read_preset("controller.presets", "practical_smith").text
    stated = re.search(r"# +stable +up to (\d+) ms", text)
    assert stated
    ends = []
    for each in "abcd":
        vehicle = corner(each, 0).vehicle
        values = {
            "speed_m_s": vehicle.speed_km_h / 3.6,
            "virtual_mass_kg": vehicle.virtual_mass_kg,
        }
        model = vehicle_of(settings).model_copy(update=values).model
        ((first_ns, last_ns),) = stable_delays(SampledLoop(design_law(settings), model, PERIOD_NS))
        assert first_ns == 0
        ends.append(last_ns)
    assert math.floor(min(ends) / 1e6) == int(stated[1])


# Settings and words


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (('law="smith"',), r"law = 'smith' needs the table \[smith\]"),
        (('law="delayed_set_point"',), r"needs the table \[delayed_set_point\]"),
        (("smith={delay_s=-0.1}",), "smith.delay_s"),
        (("smith={delay_s=2.5}",), "smith.delay_s"),
        (("smith={delay_s=0.1, washout_rad_s=400}",), "must be below pi"),
        ((*SET_POINT, *FEED_FORWARD), "takes the map's curvature by itself"),
        ((*SET_POINT, "delayed_set_point.proportional_gain=11"), "proportional_gain"),
        (("feed_forward={gain=3}",), "feed_forward.gain"),
        (('nominal_model={kind="paper_eq19"}', *FEED_FORWARD), "needs nominal_model.kind"),
        (('nominal_model={kind="paper_eq19"}', *SET_POINT), "needs nominal_model.kind"),
    ],
)
def test_settings_without_sense_are_refused(overrides: Sequence[str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        preset("practical_pd", overrides)


def test_the_predictor_takes_no_feed_forward() -> None:
    overrides = ('law="predictor"', "predictor={}", *FEED_FORWARD)
    with pytest.raises(SettingsError, match="steers for the curvature that it estimates"):
        preset("practical_pd_ddob", overrides)


def test_a_law_that_reads_the_yaw_rate_is_not_taken_for_a_linear_one() -> None:
    with pytest.raises(NotLinearError):
        law_system(design_law(preset("practical_pd", SET_POINT)))


def test_the_check_says_what_can_be_said_of_each() -> None:
    assert "stable at     0.00 to " in check_text(preset("practical_smith"))
    assert "not\n# analysed as a linear loop" in check_text(preset("practical_pd", SET_POINT))
    fed = preset("practical_pd", (*FEED_FORWARD, "rate_hz=50"))
    assert "feed-forward of the curve is outside" in check_text(fed)


def test_the_plant_hears_which_law_it_is() -> None:
    for name, overrides in (("practical_smith", ()), ("practical_pd", SET_POINT)):
        node = run_nodes(rig([], 1.0), preset(name, overrides))
        assert node.report()["law"] == preset(name, overrides).law.value
