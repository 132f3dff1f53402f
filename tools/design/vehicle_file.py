"""VEHICLE.toml: the nominal vehicle, and between which bounds its parameters may lie.

[vehicle]                              as [nominal_model] of the controller's settings, in SI
virtual_mass_kg = 2000
...
[uncertainty]                          any of the same keys, as [minimum, maximum]
virtual_mass_kg = [1600, 5000]

[car] and [actuator], as the plant's, are for designs on a road. A folder of ``steer-by-wire
identify`` has [actuator] in a file of its own.
"""

from math import sqrt
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import model_validator

from ...closed_loop.identification.vehicle_file import IdentifiedSettings
from ...controller.filters.nominal_model import NominalVehicle, steer_to_lateral_error
from ...controller.filters.settings import VehicleModelSettings
from ...controller.filters.transfer_function import TransferFunction
from ...controller.limits.designed_ranges import VehicleRanges
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...plant_emulator.vehicle.settings import LAG_S_MIN, ActuatorSettings
from ...runtime.settings import Settings, SharedTable, load_settings, read_table

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
    car: CarSettings | None = None
    actuator: ActuatorSettings | None = None
    identified: IdentifiedSettings | None = None
    """Of ``steer-by-wire identify``; its delay and lag count where there is no [actuator]."""

    @property
    def steering(self) -> dict[str, Any]:
        """Return what is known of the actuator, by its keys."""
        if self.actuator is not None:
            return self.actuator.model_dump(exclude_unset=True)
        if self.identified is None:
            return {}
        total_s = max(self.identified.delay_and_lag_s, 0.0)
        lag_s = min(sqrt(self.identified.lag_squared_s2), total_s)
        return {"lag_s": lag_s if lag_s >= LAG_S_MIN else 0.0, "dead_time_s": total_s - lag_s}

    @property
    def corners(self) -> tuple[NominalVehicle, ...]:
        """Return the vehicles at the bounds."""
        return self.uncertainty.corners(self.vehicle.vehicle)

    @property
    def models(self) -> tuple[TransferFunction, ...]:
        """Return G of each corner of the box."""
        return tuple(steer_to_lateral_error(corner) for corner in self.corners)

    def at_speeds(self, own_m_s: float, range_m_s: tuple[float, float]) -> Self:
        """Return the vehicle at this speed, and with this range of speeds."""
        nominal = self.vehicle.model_copy(update={"speed_m_s": own_m_s})
        of_box = self.uncertainty.model_copy(update={"speed_m_s": range_m_s})
        return self.model_copy(update={"vehicle": nominal, "uncertainty": of_box})

    @model_validator(mode="after")
    def _refuse_ranges_without_the_nominal_value(self) -> Self:
        ranges = self.uncertainty.given()
        if len(ranges) > _RANGES_MAX:
            raise ValueError(
                f"[uncertainty] has {len(ranges)} ranges; at most {_RANGES_MAX} are possible,"
                f" which are {2**_RANGES_MAX} corners"
            )
        for field, (minimum, maximum) in ranges.items():
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


def load_vehicle(source: Path) -> VehicleFile:
    """Return the vehicle of a file, or of a folder of ``identify``; raises SettingsError."""
    if not source.is_dir():
        return load_settings(VehicleFile, None, source)
    file = source / "actuator.toml"
    shared = None
    if file.exists():
        shared = SharedTable(str(file), {"actuator": read_table(file, "actuator")})
    return load_settings(VehicleFile, None, source / "vehicle.toml", shared=shared)
