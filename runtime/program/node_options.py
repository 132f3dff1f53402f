"""The options of a program that runs a node, and the settings that they name."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from ..command_line import (
    add_json_argument,
    add_overrides_argument,
    command_parser,
    offer,
    output_file,
    seconds,
)
from ..port.interface_choice import add_bus_arguments
from ..recording.recorder import recording_obstacle
from ..settings import Settings, SharedTable, load_settings, preset_names, preset_title, read_preset
from ..settings.mistakes import setting_words
from .priority_and_memory_lock import priority

_S = TypeVar("_S", bound=Settings)


def make_parser(
    name: str, doc: str | None, example: str, preset_package: str, model: type[Settings]
) -> argparse.ArgumentParser:
    """Return a parser with the common options; see ``command_parser`` for the arguments."""
    parser = command_parser(name, doc, example, "[SETTINGS.toml] [options]")
    add_settings_arguments(parser, preset_package, model)
    add_json_argument(parser, shows=False)
    parser.add_argument(
        "--record", type=_recording_file, metavar="FILE", help="write every frame: .log .asc .blf"
    )
    parser.add_argument(
        "-q", "--quiet", action="store_true", help="while running, print errors only"
    )
    parser.add_argument(
        "--duration", type=seconds, metavar="SECONDS", help="end after this time at the latest"
    )
    group = parser.add_argument_group("real time, as far as the host grants it")
    group.add_argument(
        "--priority", type=priority, default=50, metavar="0..99",
        help="SCHED_FIFO priority; 0 does not request it (default: %(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--no-memory-lock", dest="lock_memory", action="store_false", help="let memory be paged out"
    )
    add_bus_arguments(parser)
    return parser


def add_settings_arguments(
    parser: argparse.ArgumentParser, preset_package: str, model: type[Settings]
) -> None:
    """Add the options that ``load_program_settings`` reads."""
    parser.add_argument(
        "settings", nargs="?", type=Path, metavar="SETTINGS.toml", help="settings file"
    )
    preset = parser.add_argument(
        "--preset", metavar="NAME", nargs="?", action=_preset_action(preset_package),
        help="preset, which the file overrides; without a name, list them",
    )  # fmt: skip
    offer(preset, lambda: preset_names(preset_package))
    add_overrides_argument(parser, keys=lambda: setting_words(model))


def _preset_action(package: str) -> type[argparse.Action]:
    """Return the action of ``--preset``: without a name it lists the presets and ends."""

    class PresetAction(argparse.Action):
        def __call__(
            self, parser: argparse.ArgumentParser, options: Any, name: Any, _: Any = None
        ) -> None:
            if name is None:
                names = preset_names(package)
                width = max(map(len, names))
                rows = (f"{each:{width}}  {preset_title(package, each)}\n" for each in names)
                sys.stdout.write("".join(rows))
                parser.exit()
            options.preset = name

    return PresetAction


def load_program_settings(
    model: type[_S],
    preset_package: str,
    options: argparse.Namespace,
    overrides: Sequence[str] = (),
    shared: SharedTable | None = None,
    context: Mapping[str, Any] | None = None,
) -> _S:
    """Return the settings of the command line; raises SettingsError.

    ``overrides``  further ``table.key=value``, on top of those of ``--set``
    ``context``    for validators, as that of ``load_settings``
    """
    preset = None if options.preset is None else read_preset(preset_package, options.preset)
    own = [*options.overrides, *overrides]
    return load_settings(model, preset, options.settings, own, shared, context)


def _recording_file(text: str) -> Path:
    path = output_file(text)
    if obstacle := recording_obstacle(path):
        raise argparse.ArgumentTypeError(obstacle)
    return path


def settings_file(*packages: str, belongs: Callable[[str], bool] = bool) -> Callable[[str], Path]:
    """Return the type of an option that takes a TOML file, or one of these packages by its name.

    ``belongs``  whether a name is one of those that the option takes
    """

    def names() -> dict[str, str]:
        of_packages = ((name, package) for package in packages for name in preset_names(package))
        return {name: package for name, package in of_packages if belongs(name)}

    def read(text: str) -> Path:
        if text.endswith(".toml") or os.path.exists(text):
            return Path(text)
        if text not in (known := names()):
            raise argparse.ArgumentTypeError(
                f"{text[:60]!r} is neither a .toml file nor one of {', '.join(known)}"
            )
        return Path(str(resources.files(known[text]) / f"{text}.toml"))

    setattr(read, "values", names)  # noqa: B010 - for the shell
    return read
