"""Design gains and filters of a controller for a vehicle known within bounds.

    steer-by-wire design VEHICLE --spec SPEC [--out DIR]
    steer-by-wire design VEHICLE --frontier FRONTIER [--out DIR]

From the vehicle and its uncertainty, a range of delays, a rate and a specification to a controller
preset for each law of the specification. Leaves in DIR the presets, a picture of each law
without prediction, and prints why each value is what it is. The presets practical_* are designs of

    steer-by-wire design paper_vehicle --spec practical

A frontier compares the structures of a law: the least error of each for every delay that it
guarantees, all at the same noise. It leaves frontier.csv and pictures in DIR.

A law that meets not all demands has no preset. Its best is kept as NAME.unmet.toml, which says in
its first line that it is no design and then what was demanded and reached. The end of --minutes
ends a search with its best so far.

Exit status: 0, 1 where a law has no design, 2 for bad settings, 4 for a file that cannot be
written, 130 when interrupted.
"""

import importlib
import sys
from collections.abc import Sequence

from steer_by_wire.runtime.command_line import (
    add_json_argument,
    add_out_argument,
    add_overrides_argument,
    command_parser,
    number,
    output_folder,
    run_main,
)
from steer_by_wire.runtime.program.node_options import settings_file
from steer_by_wire.runtime.settings import preset_names
from steer_by_wire.runtime.settings.mistakes import setting_words

NAME = "steer-by-wire design"
SHIPPED = "steer_by_wire.tools.design"
"""The package with vehicles and specifications."""
FRONTIERS = f"{SHIPPED}.frontier"
MINUTES = 5.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = command_parser(
        NAME,
        __doc__,
        f"{NAME} paper_vehicle --spec practical --out out/gains",
        "VEHICLE (--spec SPEC | --frontier FRONTIER) [options]",
    )
    vehicles = [name for name in preset_names(SHIPPED) if name.endswith("_vehicle")]
    shipped = [name for name in preset_names(SHIPPED) if name not in vehicles]
    parser.add_argument(
        "vehicle", type=settings_file(SHIPPED, belongs=vehicles.__contains__), metavar="VEHICLE",
        help=f"a file, a folder of identify, or one of {', '.join(vehicles)}",
    )  # fmt: skip
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument(
        "--spec", type=settings_file(SHIPPED, belongs=shipped.__contains__), metavar="SPEC",
        help=f"a file, or one of {', '.join(shipped)}",
    )  # fmt: skip
    wanted.add_argument(
        "--frontier", type=settings_file(FRONTIERS), metavar="FRONTIER",
        help="compare the structures of a law instead: a file, or frontier",
    )  # fmt: skip
    what = "override one value of the specification"
    add_overrides_argument(parser, what, _setting_keys)
    add_out_argument(parser, "out/gains", "folder for the presets")
    parser.add_argument(
        "--pictures", type=output_folder, metavar="DIR",
        help="folder for pictures and the plant's settings (default: as --out)",
    )  # fmt: skip
    parser.add_argument(
        "--minutes", type=number(0.0, 10_000.0, excludes_low=True), default=MINUTES, metavar="M",
        help="longest search of a law (default: %(default)g)",
    )  # fmt: skip
    add_json_argument(parser, shows=False)
    options = parser.parse_args(arguments)

    def run() -> int:
        # What computes and draws takes seconds to import, which --help need not wait for.
        return int(importlib.import_module(f"{SHIPPED}.program").run_design(options))

    return run_main(NAME, run)


def _setting_keys() -> Sequence[str]:
    return setting_words(importlib.import_module(f"{SHIPPED}.specification").Specification)


if __name__ == "__main__":
    sys.exit(main())
