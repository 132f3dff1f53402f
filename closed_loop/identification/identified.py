"""Identification of a drive: fit, figures, doubts about it; and the prediction of another drive.

A lateral acceleration that the fit of the yaw rates alone contradicts is left out: roll and the
place of its sensor are in no model here. A model whose errors are large and coloured is refused.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import correlate

from ...plant_emulator.path.drivability import GRAVITY_M_S2
from ...runtime.array_types import FloatArray
from ...runtime.settings import SettingsError
from ..pair.pair_result import rms
from .figures import Figure, figures_of, half_of
from .fit import Fit, Progress, Stopped, fit, is_white, quiet, refit, samples_alike
from .parameters import (
    FRICTION_MAX,
    LONG_WHEELBASE_M,
    Known,
    Problem,
    problem_of,
    wheel_over_turning_m,
)
from .response import grid_of
from .time_series import Drive, Quantity

RESIDUAL_PERCENT_MAX = 15.0
_WORSE = 1.01
"""Factor on a yaw rate's error at which a lateral acceleration contradicts it; chosen."""
_SIDE_ALIKE_MAX = 5.0
"""Errors in a row of a lateral acceleration that tell as much as one: more are roll's."""
_SIDE_LATE_S = 0.12
_SHIFT_S = 0.008
"""A delay of a new log that differs by less is left as it is."""
_BETTER = 0.9
_NEUTRAL_PERCENT = 10.0
"""Of understeer, the small difference of two slips: below, it is not known in % of itself."""
_RATIO_MIN, _RATIO_USUAL, _RATIO_MAX = 3.0, 16.0, 40.0
"""Of steering ratios, karts and lorries included; chosen."""
_TIMES_MAX, _SIDE_TIMES_MAX, _ALIKE = 15.0, 5.0, 0.3
"""By which turning and wheel may differ, as degrees are 57 times radians; and their correlation
where the wheel makes the car turn, and no wind; chosen."""


class Doubt(NamedTuple):
    """A test of the errors, or of a simpler model, which tells something however it ends."""

    what: str
    result: str
    is_passed: bool


class Identification(NamedTuple):
    """What a drive tells of a car."""

    fit: Fit
    figures: Sequence[Figure]
    notes: Sequence[str]

    @property
    def speed_m_s(self) -> float:
        """The mean speed."""
        return float(np.mean(self.fit.grid.speed_m_s))


def identify(drive: Drive, known: Known, progress: Progress = quiet) -> Identification:
    """Return what a drive tells; raises SettingsError where no car of this model explains it."""
    notes, grid = list(drive.notes), grid_of(drive)
    problem = problem_of(drive, known)
    _refuse_wrong_unit_or_sign(drive, problem)
    found, found_all = fit(problem.seeking(), grid, progress), None
    if found.is_whole and found.values["wheelbase_m"] > LONG_WHEELBASE_M:
        problem = problem.of_long_vehicle()
        found = fit(problem.seeking(), grid, progress, found)
    rates = _of_rates(drive)
    if found.is_coloured and problem.assumed:
        # A model's error would move what is assumed.
        held = fit(problem, grid, progress, found)
        found = held if held.is_whole else found
    if found.is_coloured and len(rates.outputs) < len(drive.outputs):
        of_rates = grid._replace(judged=grid.judged[: len(rates.outputs)])
        alone = fit(problem_of(rates, known), of_rates, progress, found)
        if alone.is_whole and _contradicts(found, alone):
            _refuse_late_side(found)
            delays_ms = [1e3 * one.values["delay_and_lag_s"] for one in (found, alone)]
            notes.append(
                "lateral acceleration left out: with it the yaw rate's residual is"
                f" {found.residual_percent:.1f} %, without {alone.residual_percent:.1f} %, delay"
                f" and lag {delays_ms[0]:.0f} and {delays_ms[1]:.0f} ms: roll, or the place of its"
                " sensor (lateral_acceleration_ahead_m of --known)"
            )
            found_all, drive, found = found, rates, alone
    if found.is_whole:
        _refuse_misfit(found)
    figures = figures_of(found, progress, _others(found, progress))
    ratio = found.values["steering_ratio"]
    if "steering_ratio" not in problem.held and not _RATIO_MIN <= ratio <= _RATIO_MAX:
        notes.append(
            f"a steering ratio of {ratio:.2g} is no car's ({_RATIO_MIN:g} to {_RATIO_MAX:g}): is"
            f" the unit of {drive.steering.name} right? (unit in --columns)"
        )
    named = {one.name: one for one in figures}
    total, understeer = named["delay_and_lag_s"], named["understeer_gradient_rad_s2_m"]
    share = 100.0 * (100.0 / 3.6) ** 2 / found.values["wheelbase_m"]
    low, high = share * understeer.low, share * understeer.high
    if max(-low, high) < _NEUTRAL_PERCENT:
        notes.append(
            f"nearly neutral: in bends at 100 km/h understeer adds {share * understeer.value:.1f} %"
            f" [{low:.1f}, {high:.1f}] to the steering"
        )
    if total.high < 0.0:
        notes.append(
            f"{drive.outputs[0].name} comes {-1e3 * total.value:.0f} ms before the wheel's angle"
            " has an effect: the clocks of the two differ by at least that"
        )
    if found_all is not None:
        figures += [
            one._replace(note="with the place of its sensor", partners=())
            for one in figures_of(found_all, None)
            if one.name.startswith(Quantity.LATERAL_ACCELERATION) and one.name.endswith("delay_s")
        ]
    return Identification(found, figures, notes)


def _contradicts(found: Fit, alone: Fit) -> bool:
    """Return whether a lateral acceleration moves what the yaw rates say, or fits badly itself."""
    worse = max(rms(e) / rms(own) for e, own in zip(found.errors, alone.errors, strict=False))
    half_s = half_of(alone, "delay_and_lag_s")
    moved_s = found.values["delay_and_lag_s"] - alone.values["delay_and_lag_s"]
    of_side = max(map(samples_alike, found.errors[len(alone.errors) :]))
    return bool(worse > _WORSE or abs(moved_s) > half_s or of_side > _SIDE_ALIKE_MAX)


def _others(found: Fit, progress: Progress) -> list[Fit]:
    """Return the fit with tyres of the other kind, unless the errors say that these are right."""
    if not found.is_coloured:
        return []
    tyre = "fiala" if found.problem.known.tyre == "magic_formula" else "magic_formula"
    known = found.problem.known.model_copy(update={"tyre": tyre})
    other = fit(found.problem._replace(known=known), found.grid, progress, found)
    return [other] if other.is_whole else []


def _of_rates(drive: Drive) -> Drive:
    rates = tuple(one for one in drive.outputs if one.quantity is Quantity.YAW_RATE)
    return drive._replace(outputs=rates)


def doubts_about(found: Fit, progress: Progress = quiet) -> list[Doubt]:
    """Return the tests of a fit: simpler models, whiteness, correlation with the steering."""
    doubts, sought = list[Doubt](), [one.name for one in found.problem.parameters]
    widened = np.diagonal(found.covariance) / np.diagonal(found.plain)
    allowed = found.critical**2 * max(1.0, float(np.median(widened[: len(sought)])))
    rate, errors = found.grid.judged[0], found.errors[0]
    for what, held in (
        ("linear tyres", {"friction": FRICTION_MAX}),
        ("no relaxation", {"relaxation_m": 0.005}),
        ("neither lag nor dead time", {"delay_and_lag_s": 0.0, "lag_squared_s2": 0.0}),
    ):
        if not held.keys() <= set(sought):
            continue
        try:
            simpler = refit(found, held, progress, 1e-3)
        except Stopped:
            break
        verdict = "refused" if simpler.cost - found.cost > allowed else "not refused"
        percent = found.residual_percent * rms(simpler.errors[0]) / rms(errors)
        result = f"residual {percent:.2f} % instead of {found.residual_percent:.2f} %"
        doubts.append(Doubt(f"{what}: {verdict}", result, True))
    alike, white = max(map(samples_alike, found.errors)), all(map(is_white, found.errors))
    what = "errors are white" if white else "errors are not white: intervals are widened for it"
    doubts.append(Doubt(what, f"{alike:.1f} errors in a row tell as much as one", white))
    steering = np.interp(rate.time_s, found.grid.time_s, found.grid.steering_rad)
    largest = _cross_correlation(errors, steering)
    bound = min(3.0 * float(np.sqrt(alike / len(errors))), 0.5)
    what = (
        "errors and steering do not correlate"
        if largest < bound
        else "errors correlate with the steering: the model lacks something"
    )
    result = f"at most {largest:.2f} within 1 s, chance below {bound:.2f}"
    return [*doubts, Doubt(what, result, largest < bound)]


def _cross_correlation(errors: FloatArray, steering: FloatArray) -> float:
    """Return the largest correlation of errors with what was steered up to 100 samples before."""
    e, u = errors - errors.mean(), steering - steering.mean()
    later = correlate(e, u)[len(u) - 1 :][: min(101, len(e) // 2)]
    return float(np.abs(later).max() / np.sqrt((e @ e) * (u @ u)))


def _refuse_wrong_unit_or_sign(drive: Drive, problem: Problem) -> None:
    """Refuse turning that no tyre holds, or does not go with the wheel; raises SettingsError."""
    (steer, speed), rate = drive.at_yaw_rates(), drive.outputs[0].values
    side_m_s2 = float(np.quantile(np.abs(speed * rate), 0.99))
    if side_m_s2 > FRICTION_MAX * GRAVITY_M_S2:
        raise SettingsError(
            f"speed times yaw rate reaches {side_m_s2:.0f} m/s2, and tyres hold at most"
            f" {FRICTION_MAX * GRAVITY_M_S2:.0f}: one of them has a wrong unit, as km/h or deg/s"
            " (unit in --columns)"
        )
    alike = float(np.corrcoef(speed * (steer - steer.mean()), rate)[0, 1])
    if alike < -0.2:
        raise SettingsError(
            "the yaw rate goes against the wheel: one of them has a wrong sign, as both are"
            " positive to the left (factor = -1 in --columns), or the car spins: leave that out by"
            " --from and --to"
        )
    ratio = problem.held.get("steering_ratio", _RATIO_USUAL)
    wheelbase_m = problem.values(problem.start)["wheelbase_m"]
    times = wheel_over_turning_m(drive) / (ratio * wheelbase_m)
    if alike > _ALIKE and not 1.0 / _TIMES_MAX < times < _TIMES_MAX:
        wheel, car = drive.steering.name, drive.outputs[0].name
        much, other, unit = (wheel, car, "deg") if times > 1.0 else (car, wheel, "deg/s")
        raise SettingsError(
            f"{much} is some {max(times, 1.0 / times):.0f} times what {other} implies for a car"
            f" with steering ratio {ratio:.3g} and wheelbase {wheelbase_m:.3g} m: is it in {unit}"
            " (57 times)? Name its unit in --columns, or tell ratio and wheelbase by --known"
        )
    for side in drive.outputs:
        if side.quantity is Quantity.LATERAL_ACCELERATION:
            turning = speed * rate - np.mean(speed * rate)
            pushed = np.interp(drive.outputs[0].time_s, side.time_s, side.values)
            times = float(turning @ pushed) / float(turning @ turning)
            alike = float(np.corrcoef(turning, pushed)[0, 1])
            if alike > _ALIKE and not 1.0 / _SIDE_TIMES_MAX < times < _SIDE_TIMES_MAX:
                raise SettingsError(
                    f"{side.name} is some {times:.2g} times speed times yaw rate: is its unit"
                    " right? (unit in --columns: m_s2 or g)"
                )


def _refuse_late_side(found: Fit) -> None:
    """Refuse a car that is pushed to its side long after it turns; raises SettingsError.

    The steered axle's force turns the car and pushes it to its side at once, in front. Steered at
    the rear it is pushed to the other side first, which looks like a delay.
    """
    for name, value in found.values.items():
        is_side = name.startswith(Quantity.LATERAL_ACCELERATION)
        if is_side and name.endswith(":delay_s") and value > _SIDE_LATE_S:
            raise SettingsError(
                f"the lateral acceleration follows the yaw rate {1e3 * value:.0f} ms late, as in no"
                " car that is steered in front: steered at the rear, a wrong sign of it, or clocks"
                " that differ"
            )


def _refuse_misfit(found: Fit) -> None:
    residual, rate, errors = found.residual_percent, found.grid.judged[0], found.errors[0]
    if residual < RESIDUAL_PERCENT_MAX or is_white(errors):
        return
    side = np.abs(np.interp(rate.time_s, found.grid.time_s, found.grid.speed_m_s) * rate.values)
    hard = side > np.quantile(side, 0.8)
    at_limit = float(np.mean(errors[hard] ** 2) / np.mean(errors[~hard] ** 2))
    why = (
        "its errors lie in hard bends, at the limit of grip: load transfer, or tyres of another"
        " kind on each axle"
        if at_limit > 4.0
        else "its errors lie in all of the drive: a wrong unit or sign of a column, a clock that"
        " drifts, a steered rear axle or a trailer"
    )
    raise SettingsError(
        f"the model does not fit: residual of yaw rate {residual:.1f} %, allowed"
        f" {RESIDUAL_PERCENT_MAX:g} %; {why}"
    )


def predict(drive: Drive, vehicle: Mapping[str, float], known: Known) -> tuple[float, list[str]]:
    """Return the residual of the yaw rate [%] that a vehicle predicts for a drive, and notes.

    Only offsets of the sensors are sought. The delay of the log is corrected where it clearly
    differs from that of the vehicle's own log.
    """
    notes, drive = list(drive.notes), _of_rates(drive)
    grid, problem = grid_of(drive), problem_of(drive, known)._replace(assumed=(), held={})

    def predicted(*sought: str) -> Fit:
        of_log = {"steering_offset_rad", "yaw_rate_offset_rad_s", *sought}
        return fit(problem.holding({k: v for k, v in vehicle.items() if k not in of_log}), grid)

    found, shifted = predicted(), predicted("delay_and_lag_s")
    shift_s = shifted.values["delay_and_lag_s"] - vehicle["delay_and_lag_s"]
    if abs(shift_s) > _SHIFT_S and rms(shifted.errors[0]) < _BETTER * rms(found.errors[0]):
        notes.append(
            f"{drive.outputs[0].name} comes {1e3 * abs(shift_s):.0f} ms"
            f" {'later' if shift_s > 0.0 else 'earlier'} than in the vehicle's log: corrected"
        )
        found = shifted
    return found.residual_percent, notes
