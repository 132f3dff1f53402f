"""``--preset`` and ``--set`` of a run: each belongs to plant, controller or hand wheel."""

import argparse
import re
from collections.abc import Mapping, Sequence

from ...controller.settings import PRESETS as CONTROLLER_PRESETS
from ...controller.settings import ControllerSettings
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.settings import PRESETS as PLANT_PRESETS
from ...plant_emulator.settings import PlantSettings
from ...runtime.command_line import offer
from ...runtime.settings import Settings, SettingsError, preset_names
from ...runtime.settings.mistakes import hint, setting_words

PLANT_SIDE, CONTROLLER_SIDE, HAND_WHEEL_SIDE = "plant", "controller", "hand_wheel"
_PACKAGES: Mapping[str, str] = {PLANT_SIDE: PLANT_PRESETS, CONTROLLER_SIDE: CONTROLLER_PRESETS}
_MODELS: Mapping[str, type[Settings]] = {
    PLANT_SIDE: PlantSettings,
    CONTROLLER_SIDE: ControllerSettings,
    HAND_WHEEL_SIDE: HandWheelSettings,
}


def add_side_arguments(parser: argparse.ArgumentParser, default: str) -> None:
    """Add both options, whose values are pairs of a side and a text.

    ``default``  the controller's preset, for the help
    """
    preset = parser.add_argument(
        "--preset", type=_preset, action="append", default=[], metavar="NAME",
        help=f"preset of plant or controller, one each (default: {default}): {', '.join(_names())}",
    )  # fmt: skip
    offer(preset, _names)
    override = parser.add_argument(
        "--set", type=_override, dest="overrides", action="append", default=[],
        metavar="SIDE.KEY=VALUE",
        help="override one setting, such as plant.seed=3; repeatable",
    )  # fmt: skip
    offer(
        override,
        lambda: [f"{s}.{word}" for s, model in _MODELS.items() for word in setting_words(model)],
    )


def of_side(given: Sequence[tuple[str, str]], side: str) -> list[str]:
    """Return what was given for one side."""
    return [text for whose, text in given if whose == side]


def preset_name(options: argparse.Namespace, side: str) -> str | None:
    """Return the preset of one side, if any; raises SettingsError for two."""
    names = of_side(options.preset, side)
    if len(names) > 1:
        raise SettingsError(f"--preset: {' and '.join(names)} are both of the {side}")
    return names[0] if names else None


def _names() -> list[str]:
    return [name for package in _PACKAGES.values() for name in preset_names(package)]


def _preset(name: str) -> tuple[str, str]:
    for side, package in _PACKAGES.items():
        if name in preset_names(package):
            return side, name
    raise argparse.ArgumentTypeError(f"no preset {name[:60]!r} ({hint(name, _names())})")


def _override(text: str) -> tuple[str, str]:
    side, _, rest = text.partition(".")
    if side in _MODELS and rest:
        return side, rest
    first = re.split("[.=]", text)[0]
    owners = [name for name, model in _MODELS.items() if first in model.model_fields]
    meant = f" (did you mean {owners[0]}.{text[:60]}?)" if owners else ""
    raise argparse.ArgumentTypeError(
        f"{text[:60]!r} begins with none of plant., controller. and hand_wheel.{meant}"
    )
