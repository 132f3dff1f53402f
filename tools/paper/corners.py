"""The four vertices of the paper's uncertainty box and its published laws, as the figures use them.

Lettered a to d in the order of Table II, which the paper's text does not contradict.
"""

from functools import cache

from ...controller.filters.nominal_model import NominalVehicle, steer_to_lateral_error
from ...controller.filters.transfer_function import TransferFunction
from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.settings import plant_preset

CORNERS = ("a", "b", "c", "d")


@cache
def preset_vehicle(preset: str) -> NominalVehicle:
    """Return the vehicle of a plant's preset."""
    vehicle = plant_preset(preset).vehicle
    return NominalVehicle(**vehicle.model_dump(include=set(NominalVehicle._fields)))


def corner_vehicles() -> tuple[NominalVehicle, ...]:
    """Return the four vertices."""
    return tuple(preset_vehicle(f"paper_corner_{corner}") for corner in CORNERS)


def corner_plants() -> tuple[TransferFunction, ...]:
    """Return (4) at the four vertices, C_r = 500,000 N/rad and l_s = 2 m."""
    return tuple(steer_to_lateral_error(vehicle) for vehicle in corner_vehicles())


def corner_labels() -> tuple[str, ...]:
    """Return what the vertices are called in legends."""
    return tuple(
        f"{corner}: {3.6 * vehicle.speed_m_s:.0f} km/h, {vehicle.virtual_mass_kg:.0f} kg"
        for corner, vehicle in zip(CORNERS, corner_vehicles(), strict=True)
    )


def published_law(law: str, *overrides: str) -> ControllerSettings:
    """Return the preset paper_``law`` with settings overridden, each ``table.key=value``."""
    return controller_preset(f"paper_{law}", overrides)
