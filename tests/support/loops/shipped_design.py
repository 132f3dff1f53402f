"""The vehicle and the specification that the design of gains comes with."""

from pathlib import Path

from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.design.specification import Specification
from steer_by_wire.tools.design.vehicle_file import VehicleFile

SHIPPED = Path(__file__).resolve().parents[3] / "tools" / "design"
PAPER_VEHICLE, PRACTICAL = SHIPPED / "paper_vehicle.toml", SHIPPED / "practical.toml"


def shipped_spec(*overrides: str) -> Specification:
    return load_settings(Specification, None, PRACTICAL, overrides)


def shipped_vehicle() -> VehicleFile:
    return load_settings(VehicleFile, None, PAPER_VEHICLE)
