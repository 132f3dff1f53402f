"""VEHICLE.toml: the nominal vehicle, and between which bounds its parameters may lie.

[vehicle]                              as [nominal_model] of the controller's settings, in SI
virtual_mass_kg = 2000
...
[uncertainty]                          any of the same keys, as [minimum, maximum]
virtual_mass_kg = [1600, 5000]
"""

from typing import Any, Literal, Self

from pydantic import model_validator

from ...closed_loop.parameter_space.uncertainty import ParameterRange, UncertaintyBox
from ...controller.filters.nominal_model import steer_to_lateral_error
from ...controller.filters.settings import VehicleModelSettings
from ...controller.filters.transfer_function import TransferFunction
from ...controller.limits.designed_ranges import VehicleRanges
from ...runtime.settings import Settings

_RANGES_MAX = 6
"""2^6 corners; more would take too long."""


class VehicleTable(VehicleModelSettings):
    """`[vehicle]`: parameters of the single-track model, as in [nominal_model]."""

    kind: Literal["vehicle"] = "vehicle"


class VehicleFile(Settings):
    """All of VEHICLE.toml."""

    vehicle: VehicleTable
    uncertainty: VehicleRanges = VehicleRanges()
    """[minimum, maximum] of any of the vehicle's parameters."""
    car: dict[str, Any] | None = None
    identified: dict[str, float] | None = None
    """Both are in files of ``steer-by-wire identify``; a design needs neither."""

    @property
    def box(self) -> UncertaintyBox:
        """Return the vehicles between the bounds."""
        ranges = self.uncertainty.given().items()
        return UncertaintyBox(
            self.vehicle.vehicle, tuple(ParameterRange(key, *bounds) for key, bounds in ranges)
        )

    @property
    def models(self) -> tuple[TransferFunction, ...]:
        """Return G of each corner of the box."""
        return tuple(steer_to_lateral_error(corner) for corner in self.box.vertices())

    @model_validator(mode="after")
    def _refuse_ranges_without_the_nominal_value(self) -> Self:
        ranges = self.box.ranges
        if len(ranges) > _RANGES_MAX:
            raise ValueError(
                f"[uncertainty] has {len(ranges)} ranges; at most {_RANGES_MAX} are possible,"
                f" which are {2**_RANGES_MAX} corners"
            )
        for field, minimum, maximum in ranges:
            if minimum >= maximum:
                raise ValueError(
                    f"uncertainty.{field} = [{minimum:g}, {maximum:g}]: the minimum must be below"
                    " the maximum; leave the key out where there is no uncertainty"
                )
            nominal = getattr(self.vehicle, field)
            if not minimum <= nominal <= maximum:
                raise ValueError(
                    f"vehicle.{field} = {nominal:g} must lie within its range in [uncertainty],"
                    f" {minimum:g} to {maximum:g}"
                )
        return self
