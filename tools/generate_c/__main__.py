"""Write a controller as C99: its law and node, from the functions that run in Python.

    steer-by-wire generate-c --preset practical_pd_ddob --out law

With --feedback it writes the feedback law of a hand wheel.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.controller.settings import PRESETS, ControllerSettings
from steer_by_wire.hand_wheel.settings import PRESETS as HAND_WHEEL_PRESETS
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.runtime.command_line import add_out_argument, command_parser, run_main, say
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.node_options import add_settings_arguments, load_program_settings
from steer_by_wire.runtime.program.output_folder import refuse_another_run

from .feedback_source import feedback_source
from .law_source import law_source, title_of
from .node_source import node_source

NAME = "steer-by-wire generate-c"
GENERATED = ("steering_law.c", "steering_law.h", "node_rules.c", "node_rules.h")
DEFAULT_PRESET = "practical_pd_ddob"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the files; returns the exit status."""
    example = f"{NAME} --preset {DEFAULT_PRESET} --out law"
    parser = command_parser(NAME, __doc__, example, "[SETTINGS.toml] [options]")
    add_settings_arguments(parser, PRESETS, ControllerSettings)
    parser.add_argument(
        "--feedback", action="store_true",
        help="SETTINGS.toml, --preset and --set are of a hand wheel: write its feedback law",
    )  # fmt: skip
    add_out_argument(parser, "law", "folder for the files")
    return run_main(NAME, partial(_write, parser.parse_args(arguments)))


def _write(options: argparse.Namespace) -> int:
    if options.feedback:
        wheel = load_program_settings(HandWheelSettings, HAND_WHEEL_PRESETS, options)
        files = feedback_source(wheel, _origin(options) or "the defaults")
        _write_files(options.out, files, tuple(files))
        return ExitStatus.OK
    if options.preset is None and options.settings is None:
        options.preset = DEFAULT_PRESET
    settings = load_program_settings(ControllerSettings, PRESETS, options)
    title = title_of(settings, _origin(options))
    files = law_source(settings, title) | node_source(settings, title)
    _write_files(options.out, files, GENERATED)
    if settings.supervision.stops_if_implausible:
        watch = "the stop where the plant's signals contradict each other"
        alike = "supervision.stops_if_implausible = false takes it out of Python too"
        say(NAME, f"warning: not in C: {watch}; {alike}", sys.stderr)
    print(f"and {len(files) - len(GENERATED)} files around these: make -C {options.out}")
    return ExitStatus.OK


def _origin(options: argparse.Namespace) -> str:
    preset = [f"preset {options.preset}"] if options.preset else []
    return " and ".join([*preset, *([options.settings.name] if options.settings else [])])


def _write_files(folder: Path, files: Mapping[str, str], generated: Sequence[str]) -> None:
    refuse_another_run(folder, files)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        write_text(folder / name, text)
    for name in generated:
        print(folder / name)


if __name__ == "__main__":
    sys.exit(main())
