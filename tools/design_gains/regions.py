"""Regions of the gains for all corners of a vehicle's box, and the reason if a region is empty.

The boundaries are computed by boundary crossing (``loop_theory.parameter_space``).
"""

import math
from collections.abc import Iterator

import numpy as np

from ...controller.nominal_model import steer_to_lateral_error
from ...controller.settings import ControllerSettings
from ...loop_theory.d_stability import DStability, d_stability
from ...loop_theory.gain_boundaries import Window
from ...loop_theory.parameter_space import GainRegion, law_region, sampled_region
from ...runtime.node import NS_PER_MS
from .candidate import bounds, lattice_value
from .specification import Specification
from .vehicle_file import VehicleFile

_ALMOST_AN_AXIS_DEG = 90.001
_BELOW_NYQUIST = 0.99
_FILTERS_TRIED = 6
_LOOSER = 100.0


def pd_region(
    spec: Specification,
    vehicle: VehicleFile,
    derivative_filter_rad_s: float,
    window: Window,
    demands: DStability | None = None,
) -> GainRegion:
    """Return the gains with which the PD alone is as D-stable as specified, at every corner."""
    models = [steer_to_lateral_error(corner) for corner in vehicle.box.vertices()]
    delays_ns = [round(delay_ms * NS_PER_MS) for delay_ms in spec.d_stability.delays_ms]
    demands = demands or spec.d_stability.demands
    return sampled_region(
        models, spec.period_ns, delays_ns, derivative_filter_rad_s, demands, window
    )


def settled_region(
    spec: Specification, vehicle: VehicleFile, settings: ControllerSettings, window: Window
) -> GainRegion:
    """Return the gains with which the whole law settles at every corner.

    At no delay, the largest of the range and one half-way; neither cone nor circle are demanded.
    """
    models = [steer_to_lateral_error(corner) for corner in vehicle.box.vertices()]
    last_ns = spec.delays_ns[-1]
    demands = d_stability(
        spec.d_stability.settling_1_s, _ALMOST_AN_AXIS_DEG, _BELOW_NYQUIST * math.pi * spec.rate_hz
    )
    delays_ns = sorted({0, last_ns // 2, last_ns})
    return law_region(settings, models, spec.period_ns, delays_ns, demands, window)


def why_no_gains(spec: Specification, vehicle: VehicleFile) -> str | None:
    """Return why no gains make the PD alone as D-stable as specified; None if some do.

    Some derivative filters are tried over the range that is searched; then σ, θ, R and the delays
    are dropped one at a time.
    """
    if _any_gains(spec, vehicle, spec.d_stability.demands):
        return None
    culprits = [name for name, demands in _relaxed(spec) if _any_gains(spec, vehicle, demands)]
    undelayed = spec.d_stability.model_copy(update={"delays_ms": (0.0,)})
    without_delays = spec.model_copy(update={"d_stability": undelayed})
    if spec.d_stability != undelayed and _any_gains(without_delays, vehicle, undelayed.demands):
        culprits.append("d_stability.delays_ms")
    named = " or ".join(culprits) if culprits else "more than one of settling, cone and bandwidth"
    return f"no gains make the PD D-stable at every corner; in the way: {named}"


def _relaxed(spec: Specification) -> Iterator[tuple[str, DStability]]:
    table = spec.d_stability
    sigma, cone, radius = table.settling_1_s, table.cone_angle_deg, table.bandwidth_rad_s
    nyquist_rad_s = _BELOW_NYQUIST * math.pi * spec.rate_hz
    yield f"settling_1_s = {sigma:g}", d_stability(sigma / _LOOSER, cone, radius)
    yield f"cone_angle_deg = {cone:g}", d_stability(sigma, _ALMOST_AN_AXIS_DEG, radius)
    yield (
        f"bandwidth_rad_s = {radius:g}",
        d_stability(sigma, cone, max(radius, min(_LOOSER * radius, nyquist_rad_s))),
    )


def _any_gains(spec: Specification, vehicle: VehicleFile, demands: DStability) -> bool:
    k_p, k_d, filters = bounds("pd", vehicle.vehicle.vehicle, spec.rate_hz)
    window = Window(*(lattice_value(place) for place in (*k_p, *k_d)))
    return any(
        not pd_region(spec, vehicle, lattice_value(round(place)), window, demands).polygon.is_empty
        for place in np.linspace(*filters, _FILTERS_TRIED)
    )
