"""The four vertices of the paper's uncertainty box and its published laws, as the figures use them.

Lettered a to d in the order of Table II, which the paper's text does not contradict.
"""

from ...closed_loop.parameter_space.uncertainty import paper_box
from ...controller.filters.nominal_model import steer_to_lateral_error
from ...controller.filters.transfer_function import TransferFunction
from ...controller.settings import ControllerSettings, controller_preset

CORNERS = ("a", "b", "c", "d")


def corner_plants() -> tuple[TransferFunction, ...]:
    """Return (4) at the four vertices, C_r = 500,000 N/rad and l_s = 2 m."""
    return tuple(steer_to_lateral_error(vehicle) for vehicle in paper_box().vertices())


def corner_labels() -> tuple[str, ...]:
    """Return what the vertices are called in legends."""
    return tuple(
        f"{corner}: {3.6 * vehicle.speed_m_s:.0f} km/h, {vehicle.virtual_mass_kg:.0f} kg"
        for corner, vehicle in zip(CORNERS, paper_box().vertices(), strict=True)
    )


def published_law(law: str, *overrides: str) -> ControllerSettings:
    """Return the preset paper_``law`` with settings overridden, each ``table.key=value``."""
    return controller_preset(f"paper_{law}", overrides)
