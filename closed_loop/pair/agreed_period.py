"""The sensor period on which a pair agrees: a law that reads samples takes its plant's.

A controller on a bus cannot know the settings of its plant: it compares the period with what it
measures, and does without the delay where they differ.
"""

from ...controller.node.report_in_words import sparse_measurements
from ...controller.settings import ControllerSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.node import NS_PER_MS, NS_PER_S


def with_period_of(plant: PlantSettings, controller: ControllerSettings) -> ControllerSettings:
    """Return the settings of a controller with its plant's sensor period, if its law reads it."""
    if not _differs(plant, controller):
        return controller
    link = controller.link.model_copy(update={"sensor_period_ms": plant.sensor_period_ms})
    return controller.model_copy(update={"link": link})


def pair_warnings(plant: PlantSettings, controller: ControllerSettings) -> list[str]:
    """Return what a user should know of settings that do not go together, each in one line."""
    warnings = []
    if _differs(plant, controller):
        warnings.append(
            f"link.sensor_period_ms = {plant.sensor_period_ms:g}, as the plant has it, and not"
            f" {controller.link.sensor_period_ms:g}: law {controller.law} reads every sample"
        )
    oldest_ns = controller.age_limits.lateral_error_ns
    if plant.sensor_period_ns > oldest_ns:
        warnings.append(
            f"the plant measures every {plant.sensor_period_ms:g} ms, and the controller steers by"
            f" no measurement older than {oldest_ns / NS_PER_MS:g} ms: raise"
            " supervision.fault_tolerant_time_ms, and measurement_timeout_ms where it is set"
        )
    if sparse := sparse_measurements(controller, plant.sensor_period_ns / NS_PER_S):
        warnings.append(sparse)
    return warnings


def _differs(plant: PlantSettings, controller: ControllerSettings) -> bool:
    if plant.sensor_period_ms == controller.link.sensor_period_ms:
        return False
    return bool(controller.law_that_reads_the_vehicle)
