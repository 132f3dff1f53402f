"""The point on which a pair agrees: its plant judges the one that its controller follows."""

from ...controller.settings import ControllerSettings
from ...plant_emulator.evaluation.judged_point import FollowedPoint
from ...plant_emulator.evaluation.run_verdict import VerdictRules
from ...plant_emulator.settings import PlantSettings


def followed_point(rules: VerdictRules, controller: ControllerSettings) -> FollowedPoint:
    """Return the point that is judged: that of the rules, unless it is the preview point."""
    own = rules.followed_point
    return controller.followed_point if own == "preview" else own


def judged_like(plant: PlantSettings, controller: ControllerSettings) -> PlantSettings:
    """Return the settings of a plant that judges the point that this controller follows."""
    point = followed_point(plant.verdict, controller)
    verdict = plant.verdict.model_copy(update={"followed_point": point})
    return plant.model_copy(update={"verdict": verdict})
