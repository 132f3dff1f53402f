"""The free parameters of a law, between which bounds they are searched, and their settings."""

import math
from typing import Any

from ....controller.filters.nominal_model import NominalVehicle, steer_to_lateral_error
from ....controller.filters.settings import VehicleModelSettings
from ....controller.history.echo_delay import LinkSettings
from ....controller.limits.designed_ranges import ValiditySettings
from ....controller.settings import ControllerSettings
from ....runtime.node import NS_PER_MS
from ..specification import Specification, controller_law
from ..vehicle_file import VehicleFile
from .evolution import Values

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


def bounds(law: str, vehicle: NominalVehicle, rate_hz: float) -> dict[str, tuple[float, float]]:
    """Return between which values each parameter is searched.

    The gains are relative to the vehicle's. Below its own dynamics its response is k/s², so that
    K_p = ω²/k makes a loop of about ω. No filter is at or above the Nyquist frequency.
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
        "cdob": (0.01, min(60.0, fast)),
        "washout": (0.05, min(30.0, fast)),
    }
    return {key: ranges[key] for key in KEYS[law]}


def controller_settings(
    spec: Specification, vehicle: VehicleFile, law: str, values: Values
) -> ControllerSettings:
    """Return the settings of a law with these parameters."""
    tables: dict[str, dict[str, Any]] = {}
    if "dob" in values:
        tables["dob"] = {"q_kind": spec.dob_q_kind}
    for key, value in values.items():
        table, name = SETTINGS_KEYS[key].split(".")
        tables.setdefault(table, {})[name] = value
    return ControllerSettings(
        law=controller_law(law),
        rate_hz=spec.rate_hz,
        nominal_model=VehicleModelSettings(**vehicle.vehicle.model_dump()),
        limits=spec.limits,
        link=LinkSettings(sensor_period_ms=spec.period_ns / NS_PER_MS),
        validity=validity(vehicle, spec.delay.ms_max),
        **tables,
    )


def with_set_point(spec: Specification, settings: ControllerSettings) -> ControllerSettings:
    """Return a design with the set point that it has in a run; its loop is the same."""
    point = "centre_of_gravity" if spec.follows_car else "preview"
    return settings.model_copy(update={"followed_point": point})


def validity(
    vehicle: VehicleFile, delay_ms_max: float, judged_on: str | None = None
) -> ValiditySettings:
    """Return what a design for a box and a delay holds for, and on what it was judged, in words."""
    box = vehicle.uncertainty.given()
    return ValiditySettings(**box, delay_ms_max=delay_ms_max, judged_on=judged_on)
