"""The laws in closed loop with a vehicle of the test's own, and what each promises by itself."""

import tomllib
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from steer_by_wire.controller.law_interface import LawInput
from steer_by_wire.controller.laws.law_from_settings import design_law, required
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.controller.settings import ControllerSettings
from tests.support.loops.own_vehicle import transition

PERIOD_S = 0.01
STEER_RAD_MAX = 0.6
LAWS = ("pd", "pd_dob", "pd_cdob", "pd_ddob")
PRESETS = [f"{family}_{law}" for family in ("paper", "practical") for law in LAWS]


def preset(name: str) -> LawSettings:
    text = (
        files("steer_by_wire.controller.presets")
        .joinpath(f"{name}.toml")
        .read_text(encoding="utf-8")
    )
    tables = tomllib.loads(text) | {"followed_point": "preview"}  # what else it reads is not here
    return ControllerSettings.model_validate(tables)


def variant(name: str, **tables: Any) -> LawSettings:
    """Return a preset with some of its tables replaced."""
    return ControllerSettings.model_validate(preset(name).model_dump() | tables)


class Run(NamedTuple):
    lateral_error_m: NDArray[np.float64]
    steer_rad: NDArray[np.float64]
    disturbance_rad: NDArray[np.float64]


def close_loop(
    settings: LawSettings,
    corner: tuple[float, float],
    duration_s: float,
    start_m: float = 0.0,
    offset_rad: float = 0.0,
) -> Run:
    """Run a law at 100 Hz on a straight path, every command applied 80 ms late."""
    design, phi = design_law(settings), transition(*corner)
    x = np.array([0.0, 0.0, 0.0, start_m, 0.0, 0.0])
    state, steer, sent = design.initial_state(start_m), 0.0, [0.0] * 8
    log = []
    for k in range(round(duration_s / PERIOD_S)):
        lateral_error = float(x[3])
        state, out = design.step(design.params, state, LawInput(lateral_error, steer))
        steer = min(max(out.steer_rad, -STEER_RAD_MAX), STEER_RAD_MAX)
        sent.append(steer)
        x[4] = sent[k] + offset_rad
        x[:4] = phi @ x
        log.append((lateral_error, steer, out.disturbance_rad))
    return Run(*np.array(log).T)


def rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("name", PRESETS)
def test_a_law_starts_bumpless_from_a_constant_error(name: str) -> None:
    settings = preset(name)
    design, state = design_law(settings), design_law(settings).initial_state(0.3)
    for _ in range(5):
        state, out = design.step(design.params, state, LawInput(0.3, 0.0))
        assert out.steer_rad == pytest.approx(
            -0.3 * required(settings.pd).proportional_gain_rad_m, rel=1e-9
        )
        assert (out.disturbance_rad, out.network_disturbance_rad) == pytest.approx((0, 0), abs=1e-9)
        assert out.compensated_lateral_error_m == pytest.approx(0.3, rel=1e-9)


@pytest.mark.parametrize("name", PRESETS)
def test_parameters_and_states_are_nested_tuples_of_floats_only(name: str) -> None:
    def leaves(record: object) -> list[object]:
        if isinstance(record, tuple):
            return [leaf for item in record for leaf in leaves(item)]
        return [record]

    design = design_law(preset(name))
    state, out = design.step(design.params, design.initial_state(0.1), LawInput(0.1, 0.0))
    found = leaves((design.params, design.initial_state(0.1), state, out))
    assert {type(leaf) for leaf in found} == {float}


def test_ideal_pd_is_the_textbook_difference_equation() -> None:
    design = design_law(preset("paper_pd"))
    state = design.initial_state(0.0)
    state, first = design.step(design.params, state, LawInput(0.001, 0.0))
    _, second = design.step(design.params, state, LawInput(0.0015, 0.0))
    assert first.steer_rad == pytest.approx(-(1.0596 * 0.001 + 0.939 * 0.001 / 0.001))
    assert second.steer_rad == pytest.approx(-(1.0596 * 0.0015 + 0.939 * 0.0005 / 0.001))


@pytest.mark.parametrize("law", ["pd_dob", "pd_ddob"])
def test_the_dob_finds_a_steering_offset_and_takes_it_out(law: str) -> None:
    run = close_loop(preset(f"practical_{law}"), (5.0, 2000.0), 30.0, offset_rad=0.02)
    assert run.disturbance_rad[-1] == pytest.approx(0.02, rel=1e-3)
    assert run.steer_rad[-1] == pytest.approx(-0.02, rel=1e-3)
    assert run.lateral_error_m[-1] == pytest.approx(0.0, abs=1e-5)


def test_the_cdob_shows_the_error_as_it_were_without_the_delay() -> None:
    settings = variant("practical_pd_cdob", cdob={"q_cutoff_rad_s": 50.0, "washout_rad_s": 0.01})
    design, phi, delay = design_law(settings), transition(5.0, 2000.0), 16
    pulse = [0.1 if 20 <= k < 120 else 0.0 for k in range(150)]
    delayed, undelayed, state = np.zeros(6), np.zeros(6), design.initial_state(0.0)
    seen, undisturbed, measured = [], [], []
    for k, steer in enumerate(pulse):
        state, out = design.step(
            design.params, state, LawInput(delayed[3], pulse[k - 1] if k else 0.0)
        )
        seen.append(out.compensated_lateral_error_m)
        undisturbed.append(undelayed[3])
        measured.append(delayed[3])
        delayed[4], undelayed[4] = pulse[k - delay] if k >= delay else 0.0, steer
        delayed[:4], undelayed[:4] = phi @ delayed, phi @ undelayed
    compensated = rms(np.subtract(seen, undisturbed))
    assert compensated < 0.2 * rms(np.subtract(measured, undisturbed))


def test_a_ddob_without_washout_survives_saturation() -> None:
    """Fed with the demand before limits its CDOB would wind up and end 12 m off the path."""
    settings = variant(
        "practical_pd_ddob",
        pd={
            "proportional_gain_rad_m": 1.0596,
            "derivative_gain_rad_s_m": 0.939,
            "derivative_filter_rad_s": 5.0,
        },
        dob={"q_cutoff_rad_s": 2.0, "q_kind": "type_2"},
        cdob={"q_cutoff_rad_s": 20.0},
    )
    run = close_loop(settings, (7.0, 5000.0), 60.0, start_m=3.0)
    assert np.max(np.abs(run.steer_rad)) == STEER_RAD_MAX
    assert rms(run.lateral_error_m[3000:]) < 0.05


def test_the_paper_presets_have_the_published_values() -> None:
    for law in LAWS:
        settings = preset(f"paper_{law}")
        assert required(settings.pd).proportional_gain_rad_m == 1.0596
        assert required(settings.pd).derivative_gain_rad_s_m == 0.939
        assert required(settings.pd).derivative_filter_rad_s is None
        if settings.dob:
            assert (settings.dob.q_cutoff_rad_s, settings.dob.q_kind) == (5.0, "order_2")
        if settings.cdob:
            assert (settings.cdob.q_cutoff_rad_s, settings.cdob.washout_rad_s) == (200.0, None)
