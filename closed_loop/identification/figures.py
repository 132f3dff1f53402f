"""Figures of a car from a fit: value, 95 % interval, and whether the log identifies it.

    identified                   the interval is narrow enough
    only in combination with ..  it would be, if other parameters were known
    not identifiable             neither: the log has to show more, and ``advice`` says what

Stiffness and inertia are per kilogram. Lengths scale with the wheelbase where that is assumed.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import approx_fprime

from ...plant_emulator.path.drivability import GRAVITY_M_S2
from ...runtime.array_types import FloatArray
from .fit import Fit, Progress, Refit, Stopped, refit
from .parameters import Problem

Ends = tuple[float, float]
"""Of an interval."""
_TRIALS = 8
_NEAR = 0.1
"""Relative error of the rise that ends a search; a tenth of it is left to the cost."""
_Tried = tuple[float, dict[str, float]]
"""How much more another car costs than the best, and its parameters."""


class Verdict(StrEnum):
    """What a log knows of a figure."""

    IDENTIFIED = "identified"
    COMBINATION = "only in combination"
    NOT_IDENTIFIABLE = "not identifiable"


class Figure(NamedTuple):
    """A figure and its interval; an end is infinite where the log does not know it.

    ``note``      with what in combination, or what to drive
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    verdict: Verdict
    note: str = ""
    partners: tuple[str, ...] = ()


TOLD: Mapping[str, tuple[str, str]] = {
    "steering_ratio": ("steering_ratio", "look it up"),
    "wheelbase_m": ("wheelbase_m", "measure it"),
    "front_axle_distance_m": ("front_axle_distance_m", "weigh the axles"),
    "yaw_inertia_per_mass_m2": ("mass_kg and yaw_inertia_kg_m2", "look them up"),
    "drive_front": ("drive_front", "look it up"),
}
"""By figures of a standing car: the keys of ``Known`` that tell them, and how to find these."""
DELAYS = ("delay_and_lag_s", "lag_s", "dead_time_s")
"""A sum and its parts."""
_SHARE = 0.25
_POSITIVE = ("1", "m", "m2", "N/(rad kg)")
"""Units of what is positive: its logarithm is nearer to a normal distribution."""
_SWEEP = "drive a sweep, 26 s at 60 km/h, the wheel from 0.2 to 3 Hz"
_SLOW_SWEEP = f"{_SWEEP}, and the same at 25 km/h"
_LIMIT = "drive a slalom or a bend near the limit of grip, above 6 m/s2"
_STEPS = "drive steps of the wheel, or a sweep up to 5 Hz"
_BENDS = "drive steady bends at two speeds, 40 and 80 km/h"
_STRAIGHT = "drive straight on for 20 s, there and back"


class _Kind(NamedTuple):
    """What is told of a car.

    ``source``  the parameter whose profile bounds it
    ``enough``  half of an interval that identifies; if None, a quarter of the value
    ``advice``  what to drive where a log does not tell it
    """

    name: str
    unit: str
    source: str = ""
    enough: float | None = None
    advice: str = _SWEEP


_OF_CAR = (
    _Kind("understeer_gradient_rad_s2_m", "rad s2/m", "", 1e-3, _BENDS),
    _Kind("front_stiffness_per_mass_n_rad_kg", "N/(rad kg)", "front_c"),
    _Kind("rear_stiffness_per_mass_n_rad_kg", "N/(rad kg)", "rear_c"),
    _Kind("yaw_inertia_per_mass_m2", "m2", "inertia"),
    _Kind("friction", "1", "friction", None, _LIMIT),
    _Kind("relaxation_m", "m", "relaxation_m", None, _SLOW_SWEEP),
    _Kind("delay_and_lag_s", "s", "delay_and_lag_s", 0.01),
    _Kind("lag_s", "s", "lag_squared_s2", 0.004, _STEPS),
    _Kind("dead_time_s", "s", "", 0.004, _STEPS),
    _Kind("steering_ratio", "1", "steering_ratio"),
    _Kind("wheelbase_m", "m", "wheelbase_m"),
    _Kind("steering_offset_rad", "rad", "steering_offset_rad", 0.02, _STRAIGHT),
    _Kind("yaw_rate_offset_rad_s", "rad/s", "yaw_rate_offset_rad_s", 0.02),
)


def figure_values(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the figures of a set of parameters by name, and the parameters."""
    v, lag_s = parameters, sqrt(parameters["lag_squared_s2"])
    share, wheelbase_m = v["front_share"], v["wheelbase_m"]
    return {
        **v,
        "understeer_gradient_rad_s2_m": (1.0 / v["front_c"] - 1.0 / v["rear_c"]) / GRAVITY_M_S2,
        "front_stiffness_per_mass_n_rad_kg": v["front_c"] * GRAVITY_M_S2 * (1.0 - share),
        "rear_stiffness_per_mass_n_rad_kg": v["rear_c"] * GRAVITY_M_S2 * share,
        "yaw_inertia_per_mass_m2": v["inertia"] * share * (1.0 - share) * wheelbase_m**2,
        "lag_s": lag_s,
        "dead_time_s": v["delay_and_lag_s"] - lag_s,
        "steering_ratio_times_wheelbase_m": v["steering_ratio"] * wheelbase_m,
    }


def _kinds(problem: Problem) -> list[_Kind]:
    """Return what a problem leaves to be told."""
    found, names = [*_OF_CAR], {one.name for one in problem.coordinates}
    for name in problem.sensors[1:]:
        unit, enough = ("m/s2", 0.3) if name.startswith("lateral") else ("rad/s", 0.02)
        found += [_Kind(f"{name}:delay_s", "s", "", 0.01), _Kind(f"{name}:gain", "1")]
        found.append(_Kind(f"{name}:offset", unit, "", enough))
    if {"steering_ratio", "wheelbase_m"} <= names:
        found.append(_Kind("steering_ratio_times_wheelbase_m", "m"))
    return [one for one in found if not problem.held.keys() & {one.name, one.source}]


class _Linear(NamedTuple):
    """A figure at the best fit: derivatives by the coordinates, interval by the covariance."""

    kind: _Kind
    slope: FloatArray
    ends: Ends


def figures_of(found: Fit, progress: Progress | None, others: Sequence[Fit] = ()) -> list[Figure]:
    """Return all figures of a fit; by the covariance alone without progress, or once stopped.

    ``others``  fits of models that may be as right: each interval covers theirs, too

    Each interval also covers the cars that the profiles of other parameters have found as likely.
    Where the least costs lie on a curve, the covariance describes its tangent alone.
    """
    linear = [_linear(found, kind) for kind in _kinds(found.problem)]
    ends, tried = _profiled(found, linear, progress)
    for one in linear:
        near = [(value, value) for value in _alike(found, one, tried)]
        whole = [ends[one.kind.name], *near, *(_linear(other, one.kind).ends for other in others)]
        low, high = min(low for low, _ in whole), max(high for _, high in whole)
        ends[one.kind.name] = (max(low, 0.0) if one.kind.unit in _POSITIVE else low), high
    wide = [it.kind.name for it in linear if not _is_narrow(ends[it.kind.name], it.kind.enough)]
    ends |= zip(DELAYS, compatible(*map(ends.__getitem__, DELAYS)), strict=True)
    values = figure_values(found.values)
    values["lag_s"] = min(values["lag_s"], max(values["delay_and_lag_s"], 0.0))
    # That none is below 0 narrows a whole, and by it the parts, which the log does not tell.
    unknown = {*DELAYS} & {*wide} if DELAYS[0] in wide else set()
    return [
        _figure(found, one, values[one.kind.name], ends[one.kind.name], one.kind.name in unknown)
        for one in linear
    ]


def _is_narrow(ends: Ends, enough: float | None) -> bool:
    """Whether an interval identifies: it is no wider than ``enough`` twice."""
    return ends[1] - ends[0] <= 2.0 * (enough or inf) + 1e-9


def compatible(total: Ends, lag: Ends, dead: Ends) -> tuple[Ends, Ends, Ends]:
    """Return the intervals of a delay and of its parts, narrowed to what they allow each other.

    No effect comes before its cause, so neither part is below 0 or longer than the whole. A whole
    below 0 says that two clocks differ, and leaves no dead time.
    """
    (whole_low, whole_high), (lag_low, lag_high) = total, np.maximum(lag, 0.0).tolist()
    dead_low, dead_high = np.maximum(dead, 0.0).tolist()
    if whole_high < 0.0:
        return total, (lag_low, lag_high), (0.0, 0.0)
    if dead[1] < 0.0 or lag_low > whole_high:
        # By chance the fit's lag is beyond the whole, so it does not tell the parts.
        lag_low, dead_high = 0.0, whole_high
    whole_low = max(whole_low, lag_low + dead_low)
    lag_high = min(lag_high, whole_high - dead_low)
    dead_high = min(dead_high, whole_high - lag_low)
    lag_low = max(lag_low, whole_low - dead_high)
    dead_low = max(dead_low, whole_low - lag_high)
    return (whole_low, whole_high), (lag_low, lag_high), (dead_low, dead_high)


def _figure(found: Fit, linear: _Linear, value: float, ends: Ends, is_unknown: bool) -> Figure:
    name, unit, _, enough, advice = linear.kind
    enough = enough or _SHARE * abs(min(max(value, ends[0]), ends[1]))
    figure = figure_within(name, unit, value, ends, enough, advice)
    # Of two factors turning shows the product alone.
    factors = {"steering_ratio": "wheelbase_m", "wheelbase_m": "steering_ratio"}
    is_factor = name in factors and "wheelbase_m" in {one.name for one in found.problem.assumed}
    if figure.verdict is Verdict.IDENTIFIED and not is_unknown and not is_factor:
        return figure
    if partners := (factors[name],) if is_factor else _partners(found, linear, enough):
        note = f"with {', '.join(partners)}"
        return figure._replace(verdict=Verdict.COMBINATION, note=note, partners=partners)
    return figure._replace(verdict=Verdict.NOT_IDENTIFIABLE, note=advice)


def figure_within(
    name: str, unit: str, value: float, ends: Ends, enough: float, advice: str
) -> Figure:
    """Return a figure, which is identified if its interval is narrow enough."""
    low, high = map(float, ends)
    value = min(max(value, low), high)
    if _is_narrow(ends, enough):
        return Figure(name, unit, value, low, high, Verdict.IDENTIFIED)
    return Figure(name, unit, value, low, high, Verdict.NOT_IDENTIFIABLE, advice)


def _linear(found: Fit, kind: _Kind) -> _Linear:
    steps = [1e-4 * one.scale for one in found.problem.coordinates]
    slope: FloatArray = approx_fprime(
        found.x, lambda x: figure_values(found.problem.values(x))[kind.name], steps
    )
    value, half = figure_values(found.values)[kind.name], _half_knowing(found, slope, ())
    ends = value - half, value + half
    square_s2, half_s2 = found.values["lag_squared_s2"], half_of(found, "lag_squared_s2")
    if kind.name == "lag_s":
        ends = sqrt(max(square_s2 - half_s2, 0.0)), sqrt(square_s2 + half_s2)
    elif kind.name == "dead_time_s" and square_s2 <= half_s2:
        # The root has no slope at 0; ``compatible`` says what is left of the sum.
        ends = -inf, inf
    elif kind.unit in _POSITIVE:
        grown = float(np.exp(min(half / value, 9.0)))
        ends = value / grown, value * grown
    return _Linear(kind, slope, ends)


def _profiled(
    found: Fit, linear: Sequence[_Linear], progress: Progress | None
) -> tuple[dict[str, Ends], list[_Tried]]:
    """Return the ends by the profile where the covariance would not do, and all cars tried."""
    ends, tried = {one.kind.name: one.ends for one in linear}, list[_Tried]()
    sought = {one.name for one in found.problem.parameters}
    if progress is None:
        return ends, tried
    left = [one for one in linear if one.kind.source in sought]
    with suppress(Stopped):
        for _ in range(2):  # What the first profiles have tried may throw doubt on others.
            for one in [it for it in left if _is_doubtful(found, it, tried)]:
                left = [it for it in left if it is not one]
                own, cars = _profile(found, one.kind.source, progress)
                ends[one.kind.name] = _ends_of(found, one, own)
                tried += cars
    return ends, tried


def _is_doubtful(found: Fit, linear: _Linear, tried: Sequence[_Tried]) -> bool:
    """Whether a covariance says little: of a wide interval, near a limit, or on a curve.

    On a curve another car is as likely that lies well outside of the interval.
    """
    at = found.problem.place(linear.kind.source)
    parameter, x = found.problem.parameters[at], found.x[at]
    half = half_of(found, linear.kind.source)
    is_near = x - half <= parameter.low or x + half >= parameter.high
    if is_near or half > (_SHARE if parameter.is_log else 0.01):
        return True
    low, high = linear.ends
    beyond = _SHARE * (high - low)
    return any(not low - beyond <= it <= high + beyond for it in _alike(found, linear, tried))


def _alike(found: Fit, linear: _Linear, tried: Sequence[_Tried]) -> list[float]:
    """Return a figure of the cars that are as likely as its interval allows."""
    allowed = _allowed(found, linear.slope)
    return [figure_values(of)[linear.kind.name] for rise, of in tried if rise <= allowed]


def _profile(found: Fit, name: str, progress: Progress) -> tuple[Ends, list[_Tried]]:
    """Return the interval of a parameter's coordinate by its profile, and the cars tried for it.

    That is how far it may move, with all others sought again, before the fit is worse. A covariance
    describes the cost at its minimum; where the cost is flat, bent or ends at a limit, the profile
    says what the log knows. An end is infinite where the cost stays flat up to its limit.
    """

    def advance(_what: str, done: int, of: int) -> None:
        progress(f"profile of {name}", done, of)

    at = found.problem.place(name)
    parameter, half = found.problem.parameters[at], half_of(found, name)
    allowed = _allowed(found, np.eye(len(found.x))[at])
    tolerance = max(1e-5, 0.1 * _NEAR * allowed / found.cost)
    tried = list[_Tried]()

    def end(sign: float) -> float:
        limit = parameter.high if sign > 0.0 else parameter.low
        x = found.x[at] + sign * min(half, 0.5 * (parameter.high - parameter.low))
        near: Refit | None = None
        for _ in range(_TRIALS):
            is_limit = (x - limit) * sign >= 0.0
            x = limit if is_limit else x
            held = {name: parameter.value(x)}
            near = refit(found, held, advance, tolerance, near)
            rise = near.cost - found.cost
            tried.append((rise, found.problem.holding(held).values(near.x)))
            if (is_limit and rise < allowed) or abs(rise / allowed - 1.0) < _NEAR:
                break
            # The cost is nearly a parabola: the next step is where it would have risen enough.
            ratio = float(np.sqrt(allowed / max(rise, 1e-3 * allowed)))
            x = found.x[at] + (x - found.x[at]) * min(ratio, 4.0)
        return sign * inf if (x - limit) * sign >= 0.0 else float(x)

    return (end(-1.0), end(1.0)), tried


def _ends_of(found: Fit, linear: _Linear, ends: Ends) -> Ends:
    """Return the ends of a figure from those of its parameter's coordinate."""
    kind, (low, high) = linear.kind, ends
    at, half = found.problem.place(kind.source), half_of(found, kind.source)
    parameter, x = found.problem.parameters[at], found.x[at]
    if found.is_coloured:
        # The errors of a wrong car bend the cost, too: a narrower profile would be theirs.
        low = min(low, x - half if x - half > parameter.low else -inf)
        high = max(high, x + half if x + half < parameter.high else inf)
    if kind.name != kind.source and kind.source != "lag_squared_s2":
        # Of a product the profile of one factor tells no more than whether there is an end.
        return (
            -inf if low == -inf else linear.ends[0],
            inf if high == inf else linear.ends[1],
        )
    lower, higher = (
        end if abs(end) == inf
        else figure_values({**found.values, kind.source: parameter.value(end)})[kind.name]
        for end in (low, high)
    )  # fmt: skip
    return lower, higher


def _allowed(found: Fit, slope: FloatArray) -> float:
    """Return how much more than the best fit a car may cost, for a figure with this slope.

    That is the square of the critical value, times how much wider the errors of the model, and what
    is assumed, make the variance.
    """
    sought = slope[: len(found.bare)]
    bare = float(sought @ found.bare @ sought)
    return found.critical**2 * float(slope @ found.covariance @ slope) / max(bare, 1e-300)


def half_of(found: Fit, parameter: str) -> float:
    """Return half of the interval of a parameter's coordinate."""
    at = found.problem.place(parameter)
    return found.critical * sqrt(float(found.covariance[at, at]))


def _partners(found: Fit, linear: _Linear, enough: float) -> tuple[str, ...]:
    """Return what, once known, would make a figure narrow enough; or nothing.

    That is one parameter, or else some of TOLD that do it together, of which none can be spared.
    """
    names = [one.name for one in found.problem.coordinates]
    sources = [names[at] for at in np.flatnonzero(linear.slope)]
    itself = [linear.kind.source] if len(sources) > 1 else [linear.kind.source, *sources]
    others = [one for one in names if one not in itself]

    def is_enough(known: Sequence[str]) -> bool:
        return _half_knowing(found, linear.slope, known) < enough

    best = min(others, key=lambda one: _half_knowing(found, linear.slope, [one]))
    known = [one for one in others if user_name(found.problem, one) in TOLD]
    if is_enough([best]):
        return (user_name(found.problem, best),)
    if not is_enough(known):
        return ()
    for one in tuple(known):
        fewer = [other for other in known if other != one]
        known = fewer if is_enough(fewer) else known
    return tuple(user_name(found.problem, one) for one in known)


def _half_knowing(found: Fit, slope: FloatArray, known: Sequence[str]) -> float:
    """Return half of the interval of a figure, by its slope, were some coordinates known."""
    at = [place for place, one in enumerate(found.problem.coordinates) if one.name in known]
    along = found.covariance @ slope
    told = along[at] @ np.linalg.pinv(found.covariance[np.ix_(at, at)], hermitian=True) @ along[at]
    return found.critical * sqrt(max(float(slope @ along - told), 0.0))


def user_name(problem: Problem, parameter: str) -> str:
    """Return the name of the figure that a parameter is for the user."""
    names = {one.source: one.name for one in _kinds(problem)}
    return {**names, "front_share": "front_axle_distance_m"}.get(parameter, parameter)
