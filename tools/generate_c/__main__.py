"""Write a controller as C99: a law from the functions that run in Python, and the node around it.

steer-by-wire generate-c --preset practical_pd_ddob --out law
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from steer_by_wire.controller.settings import PRESETS, ControllerSettings
from steer_by_wire.runtime.command_line import add_out_argument, command_parser, run_main, say
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.node_options import add_settings_arguments, load_program_settings
from steer_by_wire.runtime.program.output_folder import refuse_another_run

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
    add_out_argument(parser, "law", "folder for the files")
    return run_main(NAME, partial(_write, parser.parse_args(arguments)))


def _write(options: argparse.Namespace) -> int:
    if options.preset is None and options.settings is None:
        options.preset = DEFAULT_PRESET
    settings = load_program_settings(ControllerSettings, PRESETS, options)
    preset = [f"preset {options.preset}"] if options.preset else []
    origin = [*preset, *([options.settings.name] if options.settings else [])]
    title = title_of(settings, " and ".join(origin))
    files = law_source(settings, title) | node_source(settings, title)
    refuse_another_run(options.out, files)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        write_text(options.out / name, text)
    if settings.supervision.stops_if_implausible:
        watch = "the stop where the plant's signals contradict each other"
        say(NAME, f"warning: not in C: {watch} (supervision.stops_if_implausible)", sys.stderr)
    for name in GENERATED:
        print(options.out / name)
    print(f"and {len(files) - len(GENERATED)} files around these: make -C {options.out}")
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
