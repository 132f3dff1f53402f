"""Shows frames bit by bit, and bounds the response times of messages.

steer-by-wire can bits 100#0123456789ABCDEF
steer-by-wire can response-times FILE.dbc...
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from steer_by_wire.runtime.command_line import add_subcommand, command_parser, run_main
from steer_by_wire.runtime.program.bus_options import bit_rate, data_bit_rate
from steer_by_wire.tools.can import bits, response_times

NAME = "steer-by-wire can"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one of the two subcommands; returns the exit status."""
    example = f"{bits.EXAMPLE}\n{response_times.EXAMPLE}"
    parser = command_parser(NAME, __doc__, example, "bits|response-times ...")
    parsers = parser.add_subparsers(prog=NAME, dest="subcommand", required=True, metavar="")
    for name, module in (("bits", bits), ("response-times", response_times)):
        added = add_subcommand(parsers, name, module.__doc__, module.EXAMPLE, module.USAGE)
        module.add_arguments(added)
        _add_bit_rates(added)
        added.set_defaults(run=module.run, name=module.NAME)
    options = parser.parse_args(arguments)
    return run_main(options.name, partial(options.run, options))


def _add_bit_rates(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--bitrate", type=bit_rate, default=500_000, metavar="BIT_S", help="default: %(default)s"
    )
    parser.add_argument(
        "--data-bitrate", type=data_bit_rate, default=2_000_000, metavar="BIT_S",
        help="bit rate of CAN FD's data phase (default: %(default)s)",
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
