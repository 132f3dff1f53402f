"""[validity]: what a preset was designed for. Beyond it nothing is known of the loop.

The ranges are those of the box that `steer-by-wire design` judged, around [nominal_model]. Speed
and delay are watched while the controller runs; ``--check`` judges the corners.

The vehicle's gain from steer to lateral acceleration goes with the square of its speed V. Beyond
the largest speed V_max a law therefore asks for (V_max/V)² of its steer only. The predictor, whose
gains follow the speed, lowers its weight of the error instead
(``controller.prediction.gains_over_speed``).
"""

import math
from collections.abc import Mapping
from itertools import product
from typing import Annotated, Self

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


class ValiditySettings(VehicleRanges):
    """The box, and the longest delay from command to wheel."""

    delay_ms_max: Annotated[float, Field(ge=0.0, le=2000.0)]

    def corners(self, nominal: NominalVehicle) -> tuple[NominalVehicle, ...]:
        """Return the 2^n corners of the box around a nominal vehicle."""
        given = self.given()
        return tuple(
            nominal._replace(**dict(zip(given, values, strict=True)))
            for values in product(*given.values())
        )

    @model_validator(mode="after")
    def _refuse_empty_ranges(self) -> Self:
        for key, (minimum, maximum) in self.given().items():
            if minimum >= maximum:
                raise ValueError(f"{key} = [{minimum:g}, {maximum:g}]: the minimum must be below")
        return self


NOT_FORWARD_M_S = 0.1
"""A vehicle slower than this stands or reverses, and no law steers it."""
_TOLERANCE_M_S = resolutions(VehicleState)["speed_m_s"]
_TO_SLOW_DOWN = frozenset({Validity.SPEED_HIGH, Validity.DELAY_LONG, Validity.MODEL_MISFIT})
_NO_REQUEST, _SLOW_DOWN, _STOP = MotionRequest
_IN_WORDS: Mapping[Validity, str] = {
    Validity.UNKNOWN: "",
    Validity.VALID: "",
    Validity.SPEED_LOW: "the vehicle is slower than the settings are designed for",
    Validity.SPEED_HIGH: "the vehicle is too fast for the settings: the law steers less",
    Validity.DELAY_LONG: "the delay is too long for the settings",
    Validity.MODEL_MISFIT: "the model does not fit: the vehicle is none of the settings'",
}


def tolerated_m_s(low_m_s: float, high_m_s: float) -> tuple[float, float]:
    """Return a range of speeds with the signal's resolution at either end."""
    return low_m_s - _TOLERANCE_M_S, high_m_s + _TOLERANCE_M_S


def validity_of(
    table: ValiditySettings | None,
    speed_m_s: float | None,
    delay_s: float | None,
    *,
    fits_model: bool = True,
) -> Validity:
    """Return whether a speed and a delay are within the ranges; an unknown one counts as within.

    ``delay_s``     from command to measurement [s]
    ``fits_model``  whether the vehicle is within the ranges, as far as is known
    """
    if table is None:
        return Validity.UNKNOWN
    least_m_s, most_m_s = tolerated_m_s(*(table.speed_m_s or (0.0, math.inf)))
    if speed_m_s is not None and speed_m_s > most_m_s:
        return Validity.SPEED_HIGH
    if delay_s is not None and delay_s > 1e-3 * table.delay_ms_max:
        return Validity.DELAY_LONG
    if not fits_model:
        return Validity.MODEL_MISFIT
    is_low = speed_m_s is not None and speed_m_s < least_m_s
    return Validity.SPEED_LOW if is_low else Validity.VALID


def request_of(validity: Validity, *, must_stop: bool) -> MotionRequest:
    """Return what to ask of the vehicle's drive."""
    if must_stop:
        return _STOP
    return _SLOW_DOWN if validity in _TO_SLOW_DOWN else _NO_REQUEST


def share_of_demand(table: ValiditySettings | None, speed_m_s: float) -> float:
    """Return which share of its steer a law may ask for at a speed."""
    if table is None or table.speed_m_s is None:
        return 1.0
    high_m_s = table.speed_m_s[1]
    ratio = high_m_s / max(speed_m_s, high_m_s)
    return 1.0 if speed_m_s <= tolerated_m_s(*table.speed_m_s)[1] else ratio * ratio


def in_words(validity: Validity) -> str:
    """Return what is outside, for a screen; empty where nothing is."""
    return _IN_WORDS[validity]
