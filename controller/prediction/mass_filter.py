"""The virtual mass, measured on the bus: the yaw rate against that of models with the same wheel.

The model's (β, r) runs twice, for the lightest and for the heaviest mass that the law has gains
for, each driven by the wheel angle that STEERING_STATUS reports. The yaw rate of VEHICLE_STATE lies
between the two:

    r - r_light = w (r_heavy - r_light) + b

The share w and the bias b, which is that of a steering offset, a bank or a gyroscope, walk slowly.
A Kalman filter finds them, at the rate of VEHICLE_STATE. In a steady turn r/δ = V/(L + K V²) and K,
the understeer gradient, is proportional to the mass where the tyres are those of the settings: so w
stands for both. Less grip acts like a heavier vehicle, since the mass is m/μ.

The law takes the gains of the mass between whose limits w lies, once w is inside by more than half
its deviation; until then it keeps those it has. Without steering nothing is learnt. Plain
arithmetic; filterpy's filter is the reference
(``tests/controller/prediction/test_mass_filter.py``).
"""

from itertools import pairwise
from math import sqrt
from typing import NamedTuple

from ..law_interface import History, LoopDelay
from .regression import regressed
from .vehicle_kalman_filter import VehicleGains

MASS_RATIOS = (0.8, 1.0, 1.25, 1.6, 2.0, 2.5)
"""Masses that there are gains for, as multiples of the settings'."""
AS_SET = MASS_RATIOS.index(1.0)
NOISE_RAD2_S2 = 0.01**2
"""Variance of the residual: noise of the sensor, and a sample more or less of latency."""
WALKS = (2.5e-5, 2.5e-7)
"""Variance that w and b [rad²/s²] gain at each sample: 0.05 and 0.005 rad/s in a second."""
VARIANCES_MAX = (0.25, 0.0025)
_MARGIN = 0.5
"""By how many deviations w must be beyond a limit before the next mass is taken."""
_FORGETS_AFTER = 256

MassEnds = tuple[float, float, float, float, float]
"""w at the limits between neighbouring masses, at one speed; rising."""
NO_ENDS: MassEnds = (0.0, 0.0, 0.0, 0.0, 0.0)


class MassState(NamedTuple):
    """The filter at a sample, -1 before the first; ``light_*`` and ``heavy_*`` are the models'.

    ``choice``  which mass the law takes: a place in MASS_RATIOS
    """

    sample: int
    light_beta_rad: float
    light_r_rad_s: float
    heavy_beta_rad: float
    heavy_r_rad_s: float
    yaw_rate_rad_s: float
    share: float
    bias_rad_s: float
    variance_ww: float
    variance_wb: float
    variance_bb: float
    choice: int


def mass_as_set(ends: MassEnds) -> MassState:
    """Return the state before the first sample: the mass of the settings."""
    share = 0.5 * (ends[AS_SET - 1] + ends[AS_SET])
    p_ww, p_bb = VARIANCES_MAX
    return MassState(-1, 0.0, 0.0, 0.0, 0.0, 0.0, share, 0.0, p_ww, 0.0, p_bb, AS_SET)


def mass_to(
    light: VehicleGains,
    heavy: VehicleGains,
    ends: MassEnds,
    x: MassState,
    loop_delay: LoopDelay,
    history: History,
    yaw_rate_rad_s: float,
) -> MassState:
    """Return the filter at the newest echo; a yaw rate that has changed belongs to that sample."""
    sample, beta_1, r_1, beta_2, r_2, before_rad_s, w, b, p_ww, p_wb, p_bb, choice = x
    newest, mask = loop_delay.echo_sample, history.sample_mask
    if sample < 0 or newest - sample > _FORGETS_AFTER:
        sample, beta_1, r_1, beta_2, r_2 = newest, 0.0, yaw_rate_rad_s, 0.0, yaw_rate_rad_s
    while sample < newest:
        wheel_rad = 0.5 * (
            history.wheel_rad[sample & mask] + history.wheel_rad[(sample + 1) & mask]
        )
        beta_1, r_1 = _turned(light, beta_1, r_1, wheel_rad)
        beta_2, r_2 = _turned(heavy, beta_2, r_2, wheel_rad)
        p_ww, p_bb = min(p_ww + WALKS[0], VARIANCES_MAX[0]), min(p_bb + WALKS[1], VARIANCES_MAX[1])
        sample += 1
    if yaw_rate_rad_s != before_rad_s and loop_delay.error_sample == newest:
        w, b, p_ww, p_wb, p_bb = regressed(
            (w, b, p_ww, p_wb, p_bb), r_2 - r_1, 1.0, yaw_rate_rad_s - r_1, NOISE_RAD2_S2
        )
        margin = _MARGIN * sqrt(p_ww)
        while choice < len(ends) and w - margin > ends[choice]:
            choice += 1
        while choice > 0 and w + margin < ends[choice - 1]:
            choice -= 1
    return MassState(
        sample, beta_1, r_1, beta_2, r_2, yaw_rate_rad_s, w, b, p_ww, p_wb, p_bb, choice
    )


def _turned(
    g: VehicleGains, beta_rad: float, r_rad_s: float, wheel_rad: float
) -> tuple[float, float]:
    """Return β and r a sample later, with a mean wheel angle; d acts like a constant angle."""
    return (
        g.beta_beta * beta_rad + g.beta_r * r_rad_s + g.beta_d * wheel_rad,
        g.r_beta * beta_rad + g.r_r * r_rad_s + g.r_d * wheel_rad,
    )


def ends_between(by_mass: tuple[VehicleGains, ...]) -> MassEnds:
    """Return the limits of w at the speed of these gains, by MASS_RATIOS: halfway between two."""
    turns = [_steady_turn(g) for g in by_mass]
    shares = [(turn - turns[0]) / (turns[-1] - turns[0]) for turn in turns]
    a, b, c, d, e = (0.5 * (share + after) for share, after in pairwise(shares))
    return a, b, c, d, e


def _steady_turn(g: VehicleGains) -> float:
    """Return the steady yaw rate per wheel angle [1/s]."""
    determinant = (1.0 - g.beta_beta) * (1.0 - g.r_r) - g.beta_r * g.r_beta
    return (g.r_beta * g.beta_d + (1.0 - g.beta_beta) * g.r_d) / determinant
