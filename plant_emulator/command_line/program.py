"""Program ``steer-by-wire plant``: the plant on a CAN bus, in real time.

steer-by-wire plant --preset paper_nominal -i socketcan -c vcan0 --set latency.downlink.mean_s=0.08
"""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ...dbc.bus_language import add_dialect_argument, read_language
from ...dbc.edge import add_key_file_argument, open_edge
from ...runtime.command_line import output_file, run_main, say
from ...runtime.exit_status import ExitStatus
from ...runtime.node import ReportingNode
from ...runtime.node.end import End
from ...runtime.program.fail_if_conditions import LOOP_QUANTITIES, Ending, add_fail_if_argument
from ...runtime.program.node_options import load_program_settings, make_parser
from ...runtime.program.run_node import run_node
from ...runtime.settings import SettingsError
from ..evaluation.report_in_words import plant_summary, verdict_text
from ..evaluation.run_record import SAMPLES_MAX, write_trace
from ..faults.messages_on_bus import messages_in, naming
from ..faults.stage import with_faults
from ..node.node import OF_HAND_WHEEL, RECEIVED, SENT, PlantNode
from ..settings import PRESETS, PlantSettings, plant_motion_params, shared_vehicle
from .check_option import check_text
from .fail_if_quantities import RUN_QUANTITIES

NAME = "steer-by-wire plant"
ENDING = Ending({**RUN_QUANTITIES, **LOOP_QUANTITIES}, lambda report: verdict_text(report["node"]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = make_parser(
        NAME,
        "Emulate vehicle, path, actuator and network latency on a CAN bus.",
        f"{NAME} --preset paper_nominal --seed 7 --set latency.downlink.mean_s=0.08",
        PRESETS,
        PlantSettings,
    )
    parser.add_argument(
        "--vehicle", type=Path, metavar="VEHICLE.toml", help="take [vehicle], [car] from a file"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers")
    parser.add_argument(
        "--interventions",
        action="store_true",
        help="accept LATENCY_CONFIG and DISTURBANCE_CONFIG from anyone on the bus",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="do not run; print settings, and figures of vehicle, path and limits",
    )
    parser.add_argument("--trace", type=output_file, metavar="FILE", help="write every sample, CSV")
    add_fail_if_argument(parser, ENDING.quantities)
    add_key_file_argument(parser)
    add_dialect_argument(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    overrides = [] if options.seed is None else [f"seed={options.seed}"]
    overrides += ["interventions=allow"] if options.interventions else []
    language = read_language(options.dialect)
    settings = load_program_settings(
        PlantSettings,
        PRESETS,
        options,
        overrides,
        shared_vehicle(options.vehicle),
        naming(language),
    )
    if settings.interventions == "allow" and options.key_file is not None:
        raise SettingsError(
            "--interventions: a plant with --key-file refuses what is not authentic"
        )
    if options.check:
        print(check_text(settings), end="")
        return ExitStatus.OK
    params = plant_motion_params(settings)
    # Without a trace nothing reads the samples.
    samples_max = 0 if options.trace is None else SAMPLES_MAX

    def make_node(start_ns: int) -> ReportingNode:
        node = PlantNode(settings, start_ns, params, samples_max)
        spoken = language.at_edge(node, End.PLANT, start_ns)
        return with_faults(spoken, settings.faults, settings.seed, messages_in(language))

    conclude = partial(_conclude, options)
    of_hand_wheel = OF_HAND_WHEEL if settings.hand_wheel else ()
    edge = open_edge(End.PLANT, (*RECEIVED, *of_hand_wheel, *SENT), options, language)
    return run_node(NAME, options, settings, make_node, conclude, edge, ENDING)


def _conclude(options: argparse.Namespace, node: PlantNode) -> None:
    if options.trace is not None:
        write_trace(options.trace, node.path, node.samples)
    for heading, text in plant_summary(node.report()):
        say(NAME, f"{heading} {text}")
