"""The curvature that VEHICLE_STATE gives beside the preview point, where PATH_AHEAD does not come.

Each change is added to the filter's estimate, and its rate is taken to last until the command acts.
A ramp ρ' t that lasts t shifts the predicted state by

    Δρ = ρ' t,   ΔΨ = -V ρ' t²/2,   Δy = -V² ρ' t³/6
"""

from math import exp
from typing import NamedTuple

from ..law_interface import LawInput
from .vehicle_kalman_filter import EstimatorState


class CurveParams(NamedTuple):
    """How the curvature is read at one speed.

    ``share``  of a new value in the mean of the curvature's rate; 0: it is not read
    """

    share: float
    speed_m_s: float
    sample_s: float


class Curve(NamedTuple):
    """The curvature of VEHICLE_STATE, at which sample, -1 for none, and its rate."""

    sample: int
    curvature_1_m: float
    rate_1_m_s: float


NO_CURVE = Curve(-1, 0.0, 0.0)


def curve_params(averaging_s: float | None, speed_m_s: float, sample_s: float) -> CurveParams:
    """Return the parameters; ``averaging_s`` is the time constant of the rate, None: not read."""
    share = 0.0 if averaging_s is None else 1.0 - exp(-sample_s / averaging_s)
    return CurveParams(share, speed_m_s, sample_s)


def curve_step(p: CurveParams, x: Curve, observed: LawInput) -> Curve:
    """Return the curvature beside the preview point at the newest sample, and its rate."""
    sample, vehicle = observed.loop_delay.error_sample, observed.vehicle
    if vehicle.is_stale:
        return NO_CURVE
    curvature_1_m = vehicle.preview_curvature_1_m
    if x.sample < 0 or sample < x.sample:
        return Curve(sample, curvature_1_m, 0.0)
    if sample == x.sample:
        return x
    rate_1_m_s = (curvature_1_m - x.curvature_1_m) / ((sample - x.sample) * p.sample_s)
    return Curve(sample, curvature_1_m, x.rate_1_m_s + p.share * (rate_1_m_s - x.rate_1_m_s))


def curved(x: EstimatorState, change_1_m: float) -> EstimatorState:
    """Return an estimate on a path of another curvature."""
    sample, beta, r, psi, y, rho, d, delta, behind = x
    return EstimatorState(sample, beta, r, psi, y, rho + change_1_m, d, delta, behind)


def along_ramp(p: CurveParams, x: EstimatorState, curve: Curve, samples: float) -> EstimatorState:
    """Return a predicted state on a path whose curvature has changed at its rate for so long."""
    sample, beta, r, psi, y, rho, d, delta, behind = x
    time_s = max(samples, 0.0) * p.sample_s
    change_1_m = curve.rate_1_m_s * time_s
    way_m = p.speed_m_s * time_s
    psi -= change_1_m * way_m * 0.5
    y -= change_1_m * way_m * way_m * (1.0 / 6.0)
    return EstimatorState(sample, beta, r, psi, y, rho + change_1_m, d, delta, behind)
