"""Program ``steer-by-wire hand-wheel``: hand wheel and driver on a CAN bus, in real time.

steer-by-wire hand-wheel --preset hands_off -i socketcan -c vcan0 --set feedback.law=cdob
"""

import argparse
import csv
import io
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ..dbc.bus_language import BusLanguage
from ..dbc.edge import add_edge_arguments, open_edge, read_edge_options
from ..dbc.messages import (
    CAN_IDS,
    MESSAGE_TYPES,
    HandWheelFeedback,
    HandWheelState,
    HandWheelStatus,
    SteeringForce,
)
from ..runtime.command_line import output_file, run_main
from ..runtime.node import ReportingNode
from ..runtime.output_file import write_text
from ..runtime.program.fail_if_conditions import (
    LOOP_QUANTITIES,
    Ending,
    Quantity,
    add_fail_if_argument,
)
from ..runtime.program.node_options import load_program_settings, make_parser
from ..runtime.program.run_node import run_node
from ..runtime.settings import SettingsError
from .node import RECEIVED, SENT, HandWheelNode, HandWheelSample
from .settings import PRESETS, HandWheelSettings, shared_vehicle

NAME = "steer-by-wire hand-wheel"
SAMPLES_MAX = 10_000_000
"""In the trace of a run."""
_OURS = (SteeringForce, HandWheelState, HandWheelFeedback, HandWheelStatus)
"""What no signal of a car carries."""
QUANTITIES = {
    "wheel_amplitude_rad": Quantity(lambda report: report["node"]["amplitude_rad"] or 0.0),
    "wheel_safe_stops": Quantity(lambda report: float(report["node"]["safe_stops"])),
}
"""What ``--fail-if`` may name; the amplitude is that of shaking."""
ENDING = Ending({**QUANTITIES, **LOOP_QUANTITIES}, lambda report: str(report["node"]["verdict"]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = make_parser(
        NAME,
        "Emulate hand wheel and driver on a CAN bus, with torque by what the road does.",
        f"{NAME} --preset hands_off --set feedback.law=cdob",
        PRESETS,
        HandWheelSettings,
    )
    parser.add_argument(
        "--vehicle", type=Path, metavar="VEHICLE.toml",
        help="take [nominal_model] from [vehicle] of a file",
    )  # fmt: skip
    parser.add_argument("--trace", type=output_file, metavar="FILE", help="write every cycle, CSV")
    add_fail_if_argument(parser, ENDING.quantities)
    add_edge_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def write_hand_wheel_trace(file: Path, samples: Sequence[HandWheelSample]) -> None:
    """Write one row a cycle as CSV, with the names of the fields; raises OSError."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(HandWheelSample._fields)
    rows.writerows((*sample[:-2], sample.mode.name, sample.steered_by.name) for sample in samples)
    write_text(file, text.getvalue())


def refuse_dialect(language: BusLanguage) -> None:
    """Raise SettingsError for a dialect that does not keep the messages of a hand wheel."""
    kept = CAN_IDS.values() if language.car is None else language.car.kept_ids
    lacking = [
        name for name, kind in MESSAGE_TYPES.items() if kind in _OURS and CAN_IDS[kind] not in kept
    ]
    if lacking:
        raise SettingsError(
            f"{language.file}: keep lacks {', '.join(lacking)}, which no signal of a car carries:"
            " add them to keep, or run without --dialect"
        )


def _run(options: argparse.Namespace) -> int:
    language, vehicle = read_edge_options(options), shared_vehicle(options.vehicle)
    refuse_dialect(language)
    settings = load_program_settings(HandWheelSettings, PRESETS, options, (), vehicle)
    samples_max = 0 if options.trace is None else SAMPLES_MAX

    def make_node(start_ns: int) -> ReportingNode:
        return language.at_edge(HandWheelNode(settings, start_ns, samples_max), None, start_ns)

    def conclude(node: HandWheelNode) -> None:
        if options.trace is not None:
            write_hand_wheel_trace(options.trace, node.samples)

    edge = open_edge(None, (*RECEIVED, *SENT), options, language)
    return run_node(NAME, options, settings, make_node, conclude, edge, ENDING)
