"""Inject faults into a live bus, at set times and with a seed.

    steer-by-wire faults babble,onset_s=2,duration_s=1 -i emulated -c can0
    steer-by-wire faults spoof,magnitude=0.3 noise,onset_s=3 -i socketcan -c vcan0
    steer-by-wire faults --list

Times count from the line "ready". Ctrl-C ends it in order. Faults that a run draws from its
settings are ``[[faults]]`` of the plant.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from functools import partial

from steer_by_wire.dbc.bus_language import BusLanguage, add_dialect_argument, read_language
from steer_by_wire.dbc.messages import CAN_IDS, SteeringCommand, SteeringPlan
from steer_by_wire.runtime.command_line import (
    add_json_argument,
    command_parser,
    offer,
    run_main,
    say,
    whole_number,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import EXTENDED
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.port.interface_choice import add_bus_arguments
from steer_by_wire.runtime.port.port import open_port
from steer_by_wire.runtime.port.python_can import shutting_down
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.runtime.program.stop_request import StopRequest
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.faults.fault_frames import frame_source
from steer_by_wire.tools.faults.forged_frames import ForgedFrames, OurFrames
from steer_by_wire.tools.faults.injection import Action, Injection
from steer_by_wire.tools.faults.live_faults import LiveFault, LiveKind, list_lines, parse_fault

NAME = "steer-by-wire faults"
FAULTS_MAX = 100
SEED_MAX = 1 << 32
BITRATE_BIT_S = 500_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = command_parser(
        NAME, __doc__, f"{NAME} babble,onset_s=2,duration_s=1", "FAULT... [options]"
    )
    fault = parser.add_argument(
        "faults", nargs="*", metavar="FAULT", help="KIND[,KEY=VALUE...], see --list"
    )
    offer(fault, lambda: [str(kind) for kind in LiveKind])
    parser.add_argument("--list", action="store_true", help="list the faults")
    seed = whole_number(0, SEED_MAX)
    seed_help = "seed of all random numbers (default: %(default)s)"
    parser.add_argument("--seed", type=seed, default=1, metavar="N", help=seed_help)
    add_dialect_argument(parser, "forge the frames of a car")
    add_json_argument(parser, shows=False)
    add_bus_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    if options.list:
        print("\n".join(list_lines()))
        return ExitStatus.OK
    faults = _faults(options)
    forged = _forged(read_language(options.dialect))
    stop = StopRequest()
    with ExitStack() as stack:
        opened = open_port(options, _received(forged))
        stack.enter_context(shutting_down(opened.port))
        stack.enter_context(stop.on_signals())
        start_ns = time.monotonic_ns()
        bitrate = getattr(options, "bitrate", None) or BITRATE_BIT_S
        sources = [
            frame_source(fault, start_ns, seed, bitrate, forged)
            for seed, fault in enumerate(faults, options.seed * FAULTS_MAX)
        ]
        injection = Injection(opened.port, sources, start_ns, _print_action)
        say(NAME, f"ready on {opened.description}, seed {options.seed}")
        is_over = injection.run(stop)
    if options.json is not None:
        report = {
            "seed": options.seed,
            "ended_by": "finished" if is_over else stop.reason,
            "actions": [action._asdict() for action in injection.actions],
            "frames": injection.results,
        }
        write_json(options.json, report)
    return ExitStatus.OK


def _faults(options: argparse.Namespace) -> list[LiveFault]:
    if not 0 < len(options.faults) <= FAULTS_MAX:
        raise SettingsError(f"give 1 to {FAULTS_MAX} faults, not {len(options.faults)} (--list)")
    try:
        return [parse_fault(text) for text in options.faults]
    except ValueError as error:
        raise SettingsError(str(error)) from error


def _forged(language: BusLanguage) -> ForgedFrames:
    if language.car is None:
        return OurFrames()
    # Only a dialect needs cantools, which takes a while to import.
    from steer_by_wire.tools.faults.forged_car_frames import CarFrames

    return CarFrames(language.car)


def _received(forged: ForgedFrames) -> frozenset[int] | None:
    """Return the identifiers that it listens to; None: all, for commands of 29 bits."""
    if isinstance(forged, OurFrames):
        return frozenset({CAN_IDS[SteeringCommand], CAN_IDS[SteeringPlan]})
    command = forged.command(0.0, 0)
    return None if command.flags & EXTENDED else frozenset({command.can_id})


def _print_action(action: Action) -> None:
    clock = datetime.fromtimestamp(action.time_ns / NS_PER_S, UTC).astimezone()
    at = f"{clock:%H:%M:%S}.{clock.microsecond // 1000:03d}"
    say(NAME, f"{at}  {action.since_s:8.3f} s  {action.fault}: {action.what}")


if __name__ == "__main__":
    sys.exit(main())
