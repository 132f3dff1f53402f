"""Settings that compiled runs cannot have, and the nodes can."""

from ...controller.limits.designed_ranges import NOT_FORWARD_M_S
from ...plant_emulator.settings import PlantSettings
from ...runtime.settings import SettingsError

SLOWEST_M_S = 1.5 * NOT_FORWARD_M_S
"""The controller steers no vehicle that stands; only the nodes know when it does."""


class NotCompiledError(SettingsError):
    """Only the nodes run these settings."""


def refuse(plant: PlantSettings) -> None:
    """Raise NotCompiledError for faults of frames, equations of another package, a standing car."""
    of_frames = len(plant.faults) - len(plant.steering_failures)
    if of_frames:
        raise NotCompiledError(
            f"faults: {of_frames} of frames given, but compiled runs have none; leave these out, or"
            " run the nodes: steer-by-wire run"
        )
    if plant.vehicle.model is not None:
        raise NotCompiledError(
            f"vehicle.model = {plant.vehicle.model!r}: compiled runs have the plant's own equations"
            " of motion alone; leave it out, or run the nodes: steer-by-wire run"
        )
    if plant.car is not None and any(v < SLOWEST_M_S for _, v in plant.car.profile):
        raise NotCompiledError(
            f"car.speed below {SLOWEST_M_S:g} m/s: compiled runs have no car that stands; drive"
            " faster, or run the nodes: steer-by-wire run"
        )
