"""The set of stable delays: by hand, against eigenvalues, and against runs."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, run_compiled
from steer_by_wire.closed_loop.studies.compiled_runs import verdict_on
from steer_by_wire.controller.analysis.growing_modes import GrowingModes
from steer_by_wire.controller.analysis.sampled_loop import SLOWEST_DECAY_1_S
from steer_by_wire.controller.analysis.stable_delays import (
    DELAY_NS_MAX,
    RESOLUTION_NS,
    Interval,
    delay_margin_ns,
    stable_delays,
)
from steer_by_wire.controller.laws.law_from_settings import required
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.evaluation.run_verdict import Verdict
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.array_types import FloatArray
from tests.support.loops.wide_stretches import (
    PD,
    PD_CDOB,
    PD_DDOB,
    PD_DOB,
    PLANT,
    loop_of,
    proportional_loop,
)
from tests.support.runs.unguarded import UNGUARDED

MS_NS = 1_000_000


# By hand


def test_a_stable_stretch_shorter_than_the_scan_is_found_where_it_is_by_hand() -> None:
    """z² - (1 - g + g e) z + g e, g = 2.5: stable from 2 - g + 2 g e > 0 to g e < 1."""
    stable = stable_delays(proportional_loop(2.5))
    assert len(stable) == 1
    assert 0 <= stable[0].first_ns - 1_000_000 <= RESOLUTION_NS
    assert 0 <= 4_000_000 - stable[0].last_ns <= RESOLUTION_NS
    assert delay_margin_ns(stable) == 0  # not even stable without delay


@pytest.mark.parametrize("whole_periods", [1, 2, 5, 20])
def test_the_delay_an_integrator_tolerates_is_that_of_its_polynomial(whole_periods: int) -> None:
    """z^(n+1) - z^n + g has its zeros inside the unit circle for g < 2 sin(π/(4n + 2))."""
    gain = 2.0 * math.sin(math.pi / (4 * whole_periods + 2))
    stable = stable_delays(proportional_loop(gain))
    assert len(stable) == 1
    assert stable[0].first_ns == 0
    last_ns = delay_margin_ns(stable)
    assert last_ns is not None
    # A mode counts as stable while it decays at SLOWEST_DECAY_1_S. That costs what the continuous
    # loop y' = -g y(t - τ) gives: its rate rises by g²/(1 + π²/4) per second of delay.
    rate_rise_1_s2 = (100.0 * gain) ** 2 / (1.0 + math.pi**2 / 4.0)
    expected_ns = 10 * MS_NS * whole_periods - 1e9 * SLOWEST_DECAY_1_S / rate_rise_1_s2
    assert last_ns == pytest.approx(expected_ns, abs=2 * RESOLUTION_NS)


def test_a_loop_that_tolerates_every_delay_up_to_the_limit_has_no_margin_to_tell() -> None:
    stable = stable_delays(proportional_loop(0.01))
    assert stable == (Interval(0, DELAY_NS_MAX),)
    assert delay_margin_ns(stable) is None


# Against eigenvalues


@given(
    name=st.sampled_from(["pd", "pd_dob", "pd_cdob", "pd_ddob"]),
    rate_hz=st.sampled_from([10.0, 30.0, 100.0, 250.0]),
    derivative_filter=st.floats(1.0, 31.0),
    cutoffs=st.tuples(st.floats(0.5, 31.0), st.floats(0.5, 31.0), st.floats(0.1, 10.0)),
    q_kind=st.sampled_from(["order_2", "type_2"]),
    delay_ns=st.integers(0, 400 * MS_NS),
)
def test_the_modes_counted_are_those_of_the_eigenvalues(
    name: str,
    rate_hz: float,
    derivative_filter: float,
    cutoffs: tuple[float, float, float],
    q_kind: str,
    delay_ns: int,
) -> None:
    dob, cdob, washout = cutoffs
    tables: dict[str, Any] = {
        "pd": {**required(PD.pd).model_dump(), "derivative_filter_rad_s": derivative_filter},
        "dob": {"q_cutoff_rad_s": dob, "q_kind": q_kind},
        "cdob": {"q_cutoff_rad_s": cdob, "washout_rad_s": washout},
    }
    assert PD.nominal_model is not None
    nominal = PD.nominal_model.model_dump()
    chosen = ControllerSettings.model_validate(
        {"law": name, "rate_hz": rate_hz, "nominal_model": nominal, **tables}
    )
    loop = loop_of(chosen)
    counted = GrowingModes(loop, 400 * MS_NS).count(delay_ns)
    radius = math.exp(-SLOWEST_DECAY_1_S * loop.period_ns / 1e9)
    assert counted == np.sum(np.abs(loop.closed_loop_poles(delay_ns)) > radius)


# Against runs: a straight path, a push from the side, and what becomes of the steer

RATE_1_S = 0.05
WINDOW_S = 4.0
FASTER_MODES_GONE_S = 12.0
STEER_RAD_MIN = 8e-3
"""So close to a boundary the loop makes a limit cycle of 2 to 5 mrad of the steps of the signals on
the wire, 5 µm and 10 µrad."""
STEER_RAD_MAX = 0.6
"""Above it the limits of the steer may, in the course of a window."""


class Boundary(NamedTuple):
    """A delay beside an end of an interval, ``inside`` or not, where the rate is RATE_1_S."""

    settings: ControllerSettings
    delay_ns: int
    inside: bool


def boundaries(chosen: ControllerSettings) -> list[Boundary]:
    loop = loop_of(chosen)
    found = []
    for first_ns, last_ns in stable_delays(loop):
        for edge_ns, inwards in ((first_ns, 1), (last_ns, -1)):
            if edge_ns in (0, DELAY_NS_MAX):
                continue
            for inside in (True, False):
                side = inwards if inside else -inwards
                per_ms = abs(loop.decay_1_s(edge_ns + side * MS_NS))
                off_ms = min(RATE_1_S / per_ms, 3.0)
                found.append(Boundary(chosen, edge_ns + round(side * off_ms * MS_NS), inside))
    return found


def pushed(boundary: Boundary) -> tuple[CompiledRun, Verdict]:
    """Return a run with a push of half a second, and the verdict on it."""
    plant = plant_preset(
        "paper_nominal",
        [
            *PLANT,
            "path={kind='straight'}",
            "duration_s=60",
            f"latency.downlink.mean_s={boundary.delay_ns / 1e9!r}",
            "disturbance.steps=[{at_s=1,side_force_n=60000},{at_s=1.5,side_force_n=0}]",
        ],
    )
    unguarded = plant.model_copy(update={"safety": UNGUARDED})
    run = run_compiled(unguarded, boundary.settings)
    return run, verdict_on(unguarded, boundary.settings, run)


def growth_1_s(time_s: FloatArray, angle_rad: FloatArray) -> float:
    """Return the slope of the logarithm of the root mean square over windows [1/s]."""
    per_window = round(WINDOW_S / (time_s[1] - time_s[0]))
    windows = len(time_s) // per_window
    shape = (windows, per_window)
    rms_rad = np.sqrt(np.mean(angle_rad[: windows * per_window].reshape(shape) ** 2, axis=1))
    middle_s = (np.arange(windows) + 0.5) * WINDOW_S
    usable = (
        (middle_s > FASTER_MODES_GONE_S) & (rms_rad > STEER_RAD_MIN) & (rms_rad < STEER_RAD_MAX)
    )
    assert np.count_nonzero(usable) >= 3
    return float(np.polyfit(middle_s[usable], np.log(rms_rad[usable]), 1)[0])


@pytest.mark.parametrize(
    ("chosen", "ends"),
    [(PD, 1), (PD_DOB, 1), (PD_CDOB, 5), (PD_DDOB, 3)],
    ids=["pd", "pd_dob", "pd_cdob", "pd_ddob"],
)
def test_runs_settle_just_inside_every_boundary_and_grow_just_outside(
    chosen: ControllerSettings, ends: int
) -> None:
    beside = boundaries(chosen)
    assert len(beside) == 2 * ends
    loop = loop_of(chosen)
    for boundary in beside:
        expected_1_s = -loop.decay_1_s(boundary.delay_ns)
        assert (expected_1_s < 0.0) == boundary.inside
        run, verdict = pushed(boundary)
        growing_1_s = growth_1_s(run.time_s, run.wheel_angle_rad)
        assert growing_1_s == pytest.approx(expected_1_s, rel=0.1)
        assert (verdict is Verdict.HOLDS) == boundary.inside, verdict
