"""The free parameters of a law, which the search varies, and the regions of its gains.

The lattice of the search has short numbers: 1.00, 1.02, 1.04, ..., 2.0, 2.05, ..., 5.0, 5.1, ...,
9.9 times a power of ten: steps of 1 to 2.5 %. The search ends on it, so that the judged values are
exactly those of the preset, and nothing is rounded afterwards.

Regions are those of all corners of a vehicle's box, with the reason if one is empty. The boundaries
are computed by boundary crossing (``closed_loop.parameter_space.gain_regions``).
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ....closed_loop.parameter_space.d_stability import DStability, d_stability
from ....closed_loop.parameter_space.gain_boundaries import Window
from ....closed_loop.parameter_space.gain_regions import GainRegion, sampled_region
from ....controller.filters.nominal_model import NominalVehicle, steer_to_lateral_error
from ....controller.filters.settings import (
    CdobSettings,
    DobSettings,
    PdSettings,
    VehicleModelSettings,
)
from ....controller.history.echo_delay import LinkSettings
from ....controller.laws.law_from_settings import LawDesign, design_law
from ....controller.laws.pid import PidSettings
from ....controller.limits.designed_ranges import ValiditySettings
from ....controller.settings import ControllerSettings
from ....runtime.array_types import FloatArray
from ....runtime.node import NS_PER_MS
from ..specification import Specification, controller_law
from ..vehicle_file import VehicleFile

_MANTISSAS = (
    *(1.0 + 0.02 * index for index in range(50)),
    *(2.0 + 0.05 * index for index in range(60)),
    *(5.0 + 0.1 * index for index in range(50)),
)
_DIGITS = 3
_BELOW_NYQUIST = 0.8

KEYS = {
    "pd": ("k_p", "k_d", "derivative_filter"),
    "pid": ("k_p", "k_d", "derivative_filter", "k_i"),
    "pid_heading": ("k_p", "k_d", "derivative_filter", "k_i", "k_heading"),
    "pd_dob": ("k_p", "k_d", "derivative_filter", "dob"),
    "pd_cdob": ("k_p", "k_d", "derivative_filter", "cdob", "washout"),
    "pd_ddob": ("k_p", "k_d", "derivative_filter", "dob", "cdob", "washout"),
}
"""The free parameters of each law, and of ``pid`` with its heading gain."""

SETTINGS_KEYS = {
    "k_p": "pd.proportional_gain_rad_m",
    "k_d": "pd.derivative_gain_rad_s_m",
    "derivative_filter": "pd.derivative_filter_rad_s",
    "k_i": "pid.integral_gain_rad_m_s",
    "k_heading": "pid.heading_gain_rad_rad",
    "dob": "dob.q_cutoff_rad_s",
    "cdob": "cdob.q_cutoff_rad_s",
    "washout": "cdob.washout_rad_s",
}
"""What a free parameter is called in the controller's settings."""


class Candidate(NamedTuple):
    """A law and the places of its parameters on the lattice, in the order of KEYS."""

    law: str
    places: tuple[int, ...]

    def values(self) -> dict[str, float]:
        """Return the parameters by their keys [rad/m, rad s/m, rad/s]."""
        keys = KEYS[self.law]
        return {key: lattice_value(place) for key, place in zip(keys, self.places, strict=True)}

    def moved(self, index: int, steps: int) -> "Candidate":
        """Return the neighbour whose parameter lies some steps of the lattice further."""
        places = list(self.places)
        places[index] += steps
        return self._replace(places=tuple(places))


def lattice_value(place: int) -> float:
    """Return the number at a place; 1 is at 0."""
    decade, index = divmod(place, len(_MANTISSAS))
    return float(f"{_MANTISSAS[index] * 10.0**decade:.{_DIGITS}g}")


def lattice_place(value: float) -> int:
    """Return the place of the largest number of the lattice that is not above ``value`` > 0."""
    place = math.floor(math.log10(value)) * len(_MANTISSAS)
    while lattice_value(place + 1) <= value:
        place += 1
    while lattice_value(place) > value:
        place -= 1
    return place


def values_at(law: str, places: FloatArray) -> dict[str, float]:
    """Return the parameters between the places of the lattice, geometrically interpolated."""
    keys = KEYS[law]
    return {key: _between(place) for key, place in zip(keys, places, strict=True)}


def _between(place: float) -> float:
    low = math.floor(place)
    below, above = lattice_value(low), lattice_value(low + 1)
    return float(below * (above / below) ** (place - low))


def bounds(law: str, vehicle: NominalVehicle, rate_hz: float) -> list[tuple[int, int]]:
    """Return the places between which each parameter is searched.

    The gains are relative to the vehicle's. Below its own dynamics its response is k/s², so that
    K_p = ω²/k makes a loop of about ω.
    """
    model = steer_to_lateral_error(vehicle)
    (zeros,), (poles,) = model.numerator, model.denominator
    gain = zeros.s0 / poles.s0
    fast = _BELOW_NYQUIST * math.pi * rate_hz
    ranges = {
        "k_p": (0.02 / gain, 20.0 / gain),
        "k_d": (0.005 / gain, 10.0 / gain),
        "derivative_filter": (min(0.5, 0.1 * fast), fast),
        "k_i": (0.005 / gain, 10.0 / gain),
        "k_heading": (0.01, 20.0),
        "dob": (0.05, min(30.0, fast)),
        "cdob": (0.1, min(60.0, fast)),
        "washout": (0.05, min(30.0, fast)),
    }
    return [(lattice_place(ranges[k][0]), lattice_place(ranges[k][1])) for k in KEYS[law]]


def controller_settings(
    spec: Specification, vehicle: VehicleFile, law: str, values: dict[str, float]
) -> ControllerSettings:
    """Return the settings of a law with these parameters."""
    tables: dict[str, Any] = {
        "pd": PdSettings(
            proportional_gain_rad_m=values["k_p"],
            derivative_gain_rad_s_m=values["k_d"],
            derivative_filter_rad_s=values["derivative_filter"],
        )
    }
    if "k_i" in values:
        tables["pid"] = PidSettings(
            integral_gain_rad_m_s=values["k_i"], heading_gain_rad_rad=values.get("k_heading")
        )
    if "dob" in values:
        tables["dob"] = DobSettings(q_cutoff_rad_s=values["dob"], q_kind=spec.dob_q_kind)
    if "cdob" in values:
        tables["cdob"] = CdobSettings(
            q_cutoff_rad_s=values["cdob"], washout_rad_s=values["washout"]
        )
    return ControllerSettings(
        law=controller_law(law),
        rate_hz=spec.rate_hz,
        nominal_model=VehicleModelSettings(**vehicle.vehicle.model_dump()),
        limits=spec.limits,
        link=LinkSettings(sensor_period_ms=spec.period_ns / NS_PER_MS),
        validity=validity(vehicle, spec.delay.ms_max),
        **tables,
    )


def validity(vehicle: VehicleFile, delay_ms_max: float) -> ValiditySettings:
    """Return what a design for a box and a delay holds for."""
    return ValiditySettings(**vehicle.uncertainty.given(), delay_ms_max=delay_ms_max)


def any_settings(spec: Specification, vehicle: VehicleFile) -> ControllerSettings:
    """Return settings from the middle of what is searched, of the simplest law."""
    law = "pd"
    middle = [round(sum(ends) / 2) for ends in bounds(law, vehicle.vehicle.vehicle, spec.rate_hz)]
    return controller_settings(spec, vehicle, law, Candidate(law, tuple(middle)).values())


def designs(settings: ControllerSettings) -> tuple[LawDesign, LawDesign]:
    """Return the law, and its PD without any observer."""
    alone = settings.model_copy(update={"law": "pd", "pid": None, "dob": None, "cdob": None})
    return design_law(settings), design_law(alone)


_ALMOST_AN_AXIS_DEG = 90.001
_SHARE_OF_NYQUIST = 0.99
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
    table = spec.d_stability
    loops = vehicle.models, spec.period_ns, table.delays_ns, derivative_filter_rad_s
    return sampled_region(*loops, demands or table.demands, window)


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
    nyquist_rad_s = _SHARE_OF_NYQUIST * math.pi * spec.rate_hz
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
