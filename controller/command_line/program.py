"""Program ``steer-by-wire controller``: the controller on a CAN bus, at a fixed rate, in real time.

steer-by-wire controller --preset practical_pd_ddob -i socketcan -c vcan0
steer-by-wire controller --preset practical_pd_ddob --rate-hz 200 --check
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ...dbc.edge import add_edge_arguments, open_edge, read_edge_options, takes_fd
from ...dbc.messages import HandWheelState
from ...runtime.command_line import add_json_argument, command_parser, offer, run_main, say
from ...runtime.node import ReportingNode
from ...runtime.node.end import End
from ...runtime.program.fail_if_conditions import (
    LOOP_QUANTITIES,
    Ending,
    add_fail_if_argument,
    fail_status,
)
from ...runtime.program.node_options import (
    add_settings_arguments,
    load_program_settings,
    make_parser,
)
from ...runtime.program.report import show_or_write
from ...runtime.program.run_node import run_node
from ...runtime.settings import SettingsError
from ..analysis.check_figures import check_figures
from ..analysis.check_in_words import check_text
from ..analysis.check_verdict import QUANTITIES as CHECK_QUANTITIES
from ..analysis.check_verdict import found_in
from ..laws import LAWS
from ..node.node import RECEIVED, SENT, ControllerNode
from ..node.report_in_words import controller_summary, rare_measurements, verdict_text
from ..settings import PRESETS, ControllerSettings, on_bus, shared_vehicle
from .fail_if_quantities import QUANTITIES

NAME = "steer-by-wire controller"
CHECK_NAME = "steer-by-wire check"
ENDING = Ending({**QUANTITIES, **LOOP_QUANTITIES}, verdict_text, "verdict == no effect")
DEFAULT_PRESET = "practical_pd_ddob"
"""Used if neither a preset nor a file is given, because no law works without suitable values."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = make_parser(
        NAME,
        "Hold a vehicle on its path at a fixed rate, over a CAN bus.",
        f"{NAME} --preset practical_pd_ddob",
        PRESETS,
        ControllerSettings,
    )
    _add_law_arguments(parser)
    parser.add_argument(
        "--check",
        action="store_true",
        help="do not run; analyse the loop, as steer-by-wire check does",
    )
    parser.add_argument(
        "--exit-with-plant", action="store_true",
        help="end when the plant has been silent for 3 s and the command is back at zero;"
        " by default, wait for the plant to return",
    )  # fmt: skip
    add_fail_if_argument(parser, ENDING.quantities)
    add_edge_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def check_main(arguments: Sequence[str] | None = None) -> int:
    """Analyse a controller without running it; returns the exit status."""
    parser = command_parser(
        CHECK_NAME,
        "Print the settings in effect, the poles, and what delay and jitter the loop tolerates.",
        f"{CHECK_NAME} --preset practical_pd_ddob",
        "[SETTINGS.toml] [options]",
    )
    add_settings_arguments(parser, PRESETS, ControllerSettings)
    _add_law_arguments(parser)
    add_json_argument(parser)
    add_fail_if_argument(parser, CHECK_QUANTITIES)
    return run_main(CHECK_NAME, partial(_check, CHECK_NAME, parser.parse_args(arguments)))


def _add_law_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--vehicle", type=Path, metavar="VEHICLE.toml",
        help="take [nominal_model] from [vehicle] of a file",
    )  # fmt: skip
    laws = ", ".join(LAWS)
    law = parser.add_argument(
        "--law",
        metavar="NAME",
        help=f"short for --set law=NAME: {laws}, or package.module:LAW of your own",
    )
    offer(law, lambda: LAWS)
    parser.add_argument("--rate-hz", metavar="HZ", help="short for --set rate_hz=HZ: 1 to 1000")


def _run(options: argparse.Namespace) -> int:
    language = read_edge_options(options)
    if options.check:
        if options.fail_if:
            raise SettingsError(f"--fail-if of --check: use {CHECK_NAME} --fail-if")
        return _check(NAME, options)
    asked = _settings(NAME, options)
    settings = on_bus(asked, takes_fd=takes_fd(options))
    if settings.law != asked.law:
        why = f"law {asked.law} needs CAN FD on controller and plant (--fd)"
        say(NAME, f"single commands, law {settings.law}: {why}", sys.stderr)
    language.refuse_law(settings.law_that_reads_the_vehicle)

    def make_node(start_ns: int) -> ReportingNode:
        node = ControllerNode(settings, start_ns, ends_with_plant=options.exit_with_plant)
        node.leave_out(language.missing)
        return language.at_edge(node, End.CONTROLLER, start_ns)

    concluded = partial(conclude, settings)
    of_hand_wheel = (HandWheelState,) if settings.hand_wheel else ()
    edge = open_edge(End.CONTROLLER, (*RECEIVED, *of_hand_wheel, *SENT), options, language)
    return run_node(NAME, options, settings, make_node, concluded, edge, ENDING)


def _check(name: str, options: argparse.Namespace) -> int:
    settings = _settings(name, options)

    def progress(what: str) -> None:
        say(name, f"computing {what} ...", sys.stderr)

    figures = check_figures(settings, progress)
    found = found_in(figures)._asdict()
    content = {"settings": settings.model_dump(mode="json"), **found, "analysis": figures}
    show_or_write(options.json, content, lambda: print(check_text(settings, figures), end=""))
    return fail_status(name, options.fail_if, CHECK_QUANTITIES, found)


def _settings(name: str, options: argparse.Namespace) -> ControllerSettings:
    if options.preset is None and options.settings is None:
        options.preset = DEFAULT_PRESET
        print(f"{name}: neither preset nor file is given: preset {DEFAULT_PRESET}", file=sys.stderr)
    short = {"law": options.law, "rate_hz": options.rate_hz}
    overrides = [f"{key}={value}" for key, value in short.items() if value is not None]
    return load_program_settings(
        ControllerSettings, PRESETS, options, overrides, shared_vehicle(options.vehicle)
    )


def conclude(settings: ControllerSettings, node: ControllerNode) -> None:
    """Summarise the run, and report settings that contradict the measurements."""
    report = node.report()
    if node.has_ended_with_plant:
        say(NAME, "ended with the plant, as --exit-with-plant asks")
    for heading, text in controller_summary(report):
        say(NAME, f"{heading} {text}")
    if warning := rare_measurements(settings, report):
        say(NAME, f"warning: {warning}", sys.stderr)
