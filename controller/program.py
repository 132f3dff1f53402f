"""Program ``steering-controller``: the controller on a CAN bus, at a fixed rate, in real time.

steering-controller --preset practical_pd_ddob -i socketcan -c vcan0
steering-controller --preset practical_pd_ddob --rate-hz 200 --check
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from ..dbc.secured_frame import CONTROLLER
from ..dbc.secured_program import add_key_file_argument, run_secured_node
from ..runtime.program import ExitStatus, load_program_settings, make_parser, run_main, say
from .analysis.check import check_text
from .laws import LAWS
from .node import RECEIVED, ControllerNode
from .settings import ControllerSettings

NAME = "steering-controller"
PRESETS = "steer_by_wire.controller.presets"
DEFAULT_PRESET = "practical_pd_ddob"
"""What runs when neither a preset nor a file is given: no law is good without its values."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = make_parser(NAME, "Holds a vehicle on its path at a fixed rate.", PRESETS)
    laws = ", ".join(LAWS)
    parser.add_argument(
        "--law",
        metavar="NAME",
        help=f"short for --set law=NAME: {laws}, or package.module:LAW of your own",
    )
    parser.add_argument("--rate-hz", metavar="HZ", help="short for --set rate_hz=HZ: 10 to 1000")
    parser.add_argument(
        "--check",
        action="store_true",
        help="print the settings in effect and what delay and jitter they tolerate, and do not run",
    )
    add_key_file_argument(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    if options.preset is None and options.settings is None:
        options.preset = DEFAULT_PRESET
        print(f"{NAME}: neither preset nor file is given: preset {DEFAULT_PRESET}", file=sys.stderr)
    short = {"law": options.law, "rate_hz": options.rate_hz}
    overrides = [f"{key}={value}" for key, value in short.items() if value is not None]
    settings = load_program_settings(ControllerSettings, PRESETS, options, overrides)
    if options.check:
        # The second moments of varying latencies take seconds.
        print(f"{NAME}: analysing the sampled loop ...", file=sys.stderr, flush=True)
        print(check_text(settings), end="")
        return ExitStatus.OK
    return run_secured_node(
        NAME,
        options,
        settings,
        CONTROLLER,
        lambda start_ns: ControllerNode(settings, start_ns),
        RECEIVED,
        conclude,
    )


def conclude(node: ControllerNode) -> None:
    """Say what in the settings cannot be right."""
    seen = node.report()["sensor_period"]
    if seen is not None and seen["times_wrong"]:
        say(
            NAME,
            f"the plant's sensor period was about {1e3 * seen['measured_s']:.3g} ms, but "
            f"link.sensor_period_ms = {1e3 * seen['setting_s']:g}: the law did without the delay",
            sys.stderr,
        )
