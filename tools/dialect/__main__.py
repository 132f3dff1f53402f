"""Print a first mapping for a database, or check a mapping in a run of a minute.

steer-by-wire dialect new my.dbc > car.toml
steer-by-wire dialect check car.toml --out traffic.log
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.table import Table

from steer_by_wire.closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM
from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.bus_language import BusLanguage
from steer_by_wire.dbc.dialect.dialect import Dialect, read_database, read_dialect
from steer_by_wire.dbc.dialect.proposal import proposal
from steer_by_wire.dbc.dialect.settings import Quantity
from steer_by_wire.dbc.edge import translated_text
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.command_line import add_subcommand, command_parser, output_file, run_main
from steer_by_wire.runtime.exit_status import ExitStatus

NAME = "steer-by-wire dialect"
MOTION_S = 60.0
CONTROLLER_PRESET = "practical_pd"
_NEEDED_BY = {
    Quantity.LATERAL_ERROR: "every law",
    Quantity.HEADING_ERROR: "predictor, packet",
    Quantity.WHEEL_ANGLE: "the report of the delay, and laws that use it",
    Quantity.SPEED: "laws that are scheduled by speed, predictor, packet",
    Quantity.YAW_RATE: "predictor, packet",
    Quantity.PREVIEW_CURVATURE: "predictor, packet, curvature feed-forward",
    Quantity.ENGAGED: "no one: every command counts as engaged",
}
"""What our controller lacks without a quantity."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one of the two subcommands; returns the exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} new my.dbc", "new|check ...")
    parsers = parser.add_subparsers(
        prog=NAME, dest="subcommand", required=True, metavar="SUBCOMMAND"
    )
    new = add_subcommand(parsers, "new", "Print a first mapping.", f"{NAME} new my.dbc")
    new.add_argument("database", type=Path, metavar="FILE", help="DBC, ARXML, KCD or SYM")
    new.set_defaults(run=_new)
    what = "Check a mapping, and run our plant and controller in it for a minute."
    check = add_subcommand(parsers, "check", what, f"{NAME} check car.toml --out traffic.log")
    check.add_argument("dialect", type=Path, metavar="CAR.toml")
    check.add_argument("--out", type=output_file, metavar="FILE", help="log of the traffic")
    check.set_defaults(run=_check)
    options = parser.parse_args(arguments)
    return run_main(NAME, partial(options.run, options))


def _new(options: argparse.Namespace) -> int:
    messages = read_database(options.database, "database")
    print(proposal(messages, options.database), end="")
    return ExitStatus.OK


def _check(options: argparse.Namespace) -> int:
    dialect = read_dialect(options.dialect)
    language = BusLanguage(options.dialect, dialect)
    Console(width=100).print(_table(dialect))
    missing = [one for one in _NEEDED_BY if one not in dialect.carried]
    for quantity in missing:
        print(f"missing: {quantity}: needed by {_NEEDED_BY[quantity]}")
    plant = PlantSettings(duration_s=MOTION_S)
    pair = make_virtual_pair(plant, controller_preset(CONTROLLER_PRESET), language=language)
    pair.run(BusModel(QUIET_BUS.bitrate_bit_s), options.out)
    edge, controller = pair.edge, pair.controller_edge
    for program, gateway in ((PLANT_PROGRAM, edge), (CONTROLLER_PROGRAM, controller)):
        print(f"{program.replace('_', ' ')}: {translated_text(gateway.report()['dialect'])}")
    if not edge.report()["dialect"]["accepted"]:
        print("no command was accepted: the mapping does not carry the loop")
        return ExitStatus.CONDITION
    if failure := edge.report()["failure"] or controller.report()["failure"]:
        print(f"the loop ended after {edge.report()['motion_s']:.1f} s: {failure}")
        return ExitStatus.CONDITION
    return ExitStatus.OK


def _table(dialect: Dialect) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("message", "sender", "cycle [ms]", "counter", "checksum", "carries"):
        table.add_column(heading)
    for one in dialect.messages:
        settings = one.settings
        rule = settings.checksum.rule if settings.checksum else ""
        cells = (
            f"{settings.cycle_ms:g}",
            settings.counter or "",
            rule,
            ", ".join(sorted(one.carries)),
        )
        table.add_row(f"{one.name} {one.can_id:#x}", settings.sender, *cells)
    return table


if __name__ == "__main__":
    sys.exit(main())
