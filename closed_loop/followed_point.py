"""The followed point of a pair: its plant judges the point that its controller follows."""

from ..controller.settings import ControllerSettings
from ..plant_emulator.evaluation.followed_point import FollowedPoint
from ..plant_emulator.evaluation.run_verdict import VerdictRules
from ..plant_emulator.settings import PlantSettings

NOISY_WHEEL_RAD = 0.3
"""Amplitude of the wheel from which a rhythm is an oscillation where noise moves the wheel. 20 mm
move it by 0.04 rad under the laws designed for it, which has a rhythm by chance: in a window of 5 s
every second time where the loop is resonant."""


def followed_point(rules: VerdictRules, controller: ControllerSettings) -> FollowedPoint:
    """Return the point that is judged: that of the rules, unless it is the preview point."""
    own = rules.followed_point
    return controller.followed_point if own == "preview" else own


def judged_like(plant: PlantSettings, controller: ControllerSettings) -> PlantSettings:
    """Return the settings of a plant that judges the point that this controller follows.

    Unless ``wheel_amplitude_rad`` is given, a plant with noise takes NOISY_WHEEL_RAD for it.
    """
    rules = plant.verdict
    updates: dict[str, object] = {"followed_point": followed_point(rules, controller)}
    if plant.sensor_noise.lateral_error_m and "wheel_amplitude_rad" not in rules.model_fields_set:
        updates["wheel_amplitude_rad"] = NOISY_WHEEL_RAD
    verdict = rules.model_copy(update=updates)
    return plant.model_copy(update={"verdict": verdict})
