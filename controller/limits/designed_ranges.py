"""[validity]: what a preset was designed for. Beyond it nothing is known of the loop.

The ranges are those of the box that `steer-by-wire design` judged, around [nominal_model]. Speed
and delay are watched while the controller runs; ``--check`` judges the corners.

The vehicle's gain from steer to lateral acceleration goes with the square of its speed V. Beyond
the largest speed V_max a law therefore asks for (V_max/V)² of its steer only. The predictor, whose
gains follow the speed, lowers its weight of the error instead
(``controller.prediction.gains_over_speed``).
"""

import sys
from collections.abc import Mapping
from itertools import product
from typing import Annotated, NamedTuple, Self

from pydantic import Field, model_validator

from ...dbc.messages import MotionRequest, Validity, VehicleState, resolutions
from ...runtime.settings import Settings
from ..filters.nominal_model import NominalVehicle
from ..filters.settings import (
    AxleDistanceM,
    MassKg,
    PreviewDistanceM,
    SpeedMS,
    StiffnessNRad,
    YawInertiaKgM2,
)


class VehicleRanges(Settings):
    """[minimum, maximum] of any of the vehicle's parameters."""

    virtual_mass_kg: tuple[MassKg, MassKg] | None = None
    yaw_inertia_kg_m2: tuple[YawInertiaKgM2, YawInertiaKgM2] | None = None
    front_cornering_stiffness_n_rad: tuple[StiffnessNRad, StiffnessNRad] | None = None
    rear_cornering_stiffness_n_rad: tuple[StiffnessNRad, StiffnessNRad] | None = None
    front_axle_distance_m: tuple[AxleDistanceM, AxleDistanceM] | None = None
    rear_axle_distance_m: tuple[AxleDistanceM, AxleDistanceM] | None = None
    preview_distance_m: tuple[PreviewDistanceM, PreviewDistanceM] | None = None
    speed_m_s: tuple[SpeedMS, SpeedMS] | None = None

    def given(self) -> dict[str, tuple[float, float]]:
        """Return those that are given; speed first, so that corners are in the paper's order."""
        keys = sorted(VehicleRanges.model_fields, key=lambda key: key != "speed_m_s")
        return {key: bounds for key in keys if (bounds := getattr(self, key)) is not None}

    def corners(self, nominal: NominalVehicle, points: int = 2) -> tuple[NominalVehicle, ...]:
        """Return the corners of the box around a nominal vehicle, the last range changing first.

        ``points``  in each range, evenly spread from end to end; with more than 2, also vehicles
                    between the corners
        """
        shares, given = [at / (points - 1) for at in range(points)], self.given()
        axes = [[(1.0 - x) * low + x * high for x in shares] for low, high in given.values()]
        return tuple(
            nominal._replace(**dict(zip(given, values, strict=True))) for values in product(*axes)
        )


class ValiditySettings(VehicleRanges):
    """The box, and the longest delay from command to wheel."""

    delay_ms_max: Annotated[float, Field(ge=0.0, le=2000.0)]
    judged_on: str | None = None
    """The runs behind the figures of a preset, in words, where they do not span the box."""

    @model_validator(mode="after")
    def _refuse_empty_ranges(self) -> Self:
        for key, (minimum, maximum) in self.given().items():
            if minimum >= maximum:
                raise ValueError(f"{key} = [{minimum:g}, {maximum:g}]: the minimum must be below")
        return self


NOT_FORWARD_M_S = 0.1
"""A vehicle slower than this stands or reverses, and no law steers it."""
_TOLERANCE_M_S = resolutions(VehicleState)["speed_m_s"]
_NO_LIMIT = sys.float_info.max
VALIDITY_IN_WORDS: Mapping[Validity, str] = {
    Validity.UNKNOWN: "",
    Validity.VALID: "",
    Validity.SPEED_LOW: "the vehicle is slower than the settings are designed for",
    Validity.SPEED_HIGH: "the vehicle is too fast for the settings: the law steers less",
    Validity.DELAY_LONG: "the delay is too long for the settings",
    Validity.MODEL_MISFIT: "the model does not fit: the vehicle is none of the settings'",
}

REQUEST_IN_WORDS: Mapping[MotionRequest, str] = {
    MotionRequest.NONE: "",
    MotionRequest.SLOW_DOWN: "asks the vehicle to slow down",
    MotionRequest.STOP: "asks the vehicle to stop",
}


class DesignedRanges(NamedTuple):
    """The ranges that are watched while the controller runs.

    ``is_known``           whether the settings state any
    ``speed_m_s_max``      ``tolerated_m_s_max`` and ``tolerated_m_s_min`` are wider by the signal's
                           resolution
    ``delay_s_max``        from command to measurement, wider by a control period [s]: its echo
                           shows a delay to half of it, later by the frames of the sample
    """

    is_known: bool
    speed_m_s_max: float
    tolerated_m_s_max: float
    tolerated_m_s_min: float
    delay_s_max: float


def designed_ranges_of(table: ValiditySettings | None, period_s: float) -> DesignedRanges:
    """Return the ranges of settings."""
    low_m_s, high_m_s = (table and table.speed_m_s) or (0.0, _NO_LIMIT)
    tolerated_m_s = high_m_s + _TOLERANCE_M_S, low_m_s - _TOLERANCE_M_S
    delay_s_max = 1e-3 * table.delay_ms_max + period_s if table else _NO_LIMIT
    return DesignedRanges(table is not None, high_m_s, *tolerated_m_s, delay_s_max)


def validity_of(
    p: DesignedRanges, speed_m_s: float | None, delay_s: float | None, fits_model: bool
) -> Validity:
    """Return whether a speed and a delay are within the ranges; an unknown one counts as within.

    ``delay_s``     from command to measurement, by its echo [s]
    ``fits_model``  whether the vehicle is within the ranges, as far as is known
    """
    if not p.is_known:
        return Validity.UNKNOWN
    if speed_m_s is not None and speed_m_s > p.tolerated_m_s_max:
        return Validity.SPEED_HIGH
    if delay_s is not None and delay_s > p.delay_s_max:
        return Validity.DELAY_LONG
    if not fits_model:
        return Validity.MODEL_MISFIT
    is_low = speed_m_s is not None and speed_m_s < p.tolerated_m_s_min
    return Validity.SPEED_LOW if is_low else Validity.VALID


def request_of(validity: Validity, must_stop: bool) -> MotionRequest:
    """Return what to ask of the vehicle's drive."""
    if must_stop:
        return MotionRequest.STOP
    if validity is Validity.UNKNOWN or validity is Validity.VALID:
        return MotionRequest.NONE
    return MotionRequest.NONE if validity is Validity.SPEED_LOW else MotionRequest.SLOW_DOWN


def share_of_demand(p: DesignedRanges, speed_m_s: float) -> float:
    """Return which share of its steer a law may ask for at a speed."""
    if speed_m_s <= p.tolerated_m_s_max or speed_m_s == 0.0:
        return 1.0
    ratio = p.speed_m_s_max / speed_m_s
    return ratio * ratio
