"""Watch and drive the loop in a browser: the car on its path, signals, lights, frames, the network.

    steer-by-wire cockpit
    steer-by-wire cockpit --rest-bus car.dbc --load 0.7
    steer-by-wire cockpit -i socketcan -c can0
    steer-by-wire cockpit run.log --export run.html

Without a bus and without a RECORDING it starts a plant, a controller and a bus of its own. With a
bus (-i, -c) it listens there, and sends nothing unless --allow-control is given.
"""

import argparse
import asyncio
import secrets
import sys
import time
import webbrowser
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.closed_loop.pair.live_bus import BUSES
from steer_by_wire.closed_loop.pair.rest_bus_from_dbc import traffic_of
from steer_by_wire.dbc.bus_language import add_dialect_argument, read_language
from steer_by_wire.runtime.command_line import (
    command_parser,
    ending_signals,
    offer,
    output_file,
    run_main,
    say,
    whole_number,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.port.interface_choice import add_bus_arguments
from steer_by_wire.runtime.port.port import open_port
from steer_by_wire.runtime.program.bus_options import add_traffic_arguments, bus_settings
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.cockpit.lane import Lane
from steer_by_wire.tools.cockpit.lanes import OwnLanes
from steer_by_wire.tools.cockpit.orders import open_wheel
from steer_by_wire.tools.cockpit.page import single_page
from steer_by_wire.tools.cockpit.page_access import HOST
from steer_by_wire.tools.cockpit.page_requests import Desk
from steer_by_wire.tools.cockpit.replay import read_replay
from steer_by_wire.tools.cockpit.scenario import Scenario, scenario_titled, scenarios
from steer_by_wire.tools.cockpit.server import Server, serving

NAME = "steer-by-wire cockpit"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    example = f"{NAME} --scenario 'DDOB with varying delay'\n"
    example += f"{NAME} -i socketcan -c can0\n{NAME} run.log --export run.html"
    parser = command_parser(NAME, __doc__, example, "[RECORDING...] [options]")
    parser.add_argument(
        "recordings", nargs="*", type=Path, metavar="RECORDING",
        help="one log or its parts, in any format",
    )  # fmt: skip
    parser.add_argument(
        "--export", type=output_file, metavar="FILE", help="write the replay as one page, and end"
    )
    parser.add_argument(
        "--log-channel", metavar="NAME", help="channel to replay, if there are several"
    )
    titles = [one.title for one in scenarios()]
    scenario = parser.add_argument(
        "--scenario", metavar="TITLE", help=f"preset to begin with: {', '.join(titles)}"
    )
    offer(scenario, lambda: titles)
    parser.add_argument(
        "--bus", choices=BUSES, default="auto",
        help="bus to start programs on (default: vcan0 if there is one, else emulated)",
    )  # fmt: skip
    parser.add_argument(
        "--allow-control",
        action="store_true",
        help="let the page control a bus that it did not start",
    )
    parser.add_argument(
        "--port",
        type=whole_number(0, 65_535),
        default=0,
        metavar="N",
        help="port of 127.0.0.1 (default: any free one)",
    )
    parser.add_argument(
        "--no-browser", dest="browser", action="store_false", help="only print the address"
    )
    parser.add_argument(
        "--usb-wheel", type=Path, metavar="/dev/input/eventN",
        help="steering wheel that you hold, and that gets the force feedback",
    )  # fmt: skip
    add_dialect_argument(parser, "read the messages of a car, and start programs that speak them")
    add_bus_arguments(parser)
    add_traffic_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    language = read_language(options.dialect)
    # python-can adds only what was given.
    is_own = not (options.recordings or {"interface", "channel"} & vars(options).keys())
    if options.usb_wheel is not None and not is_own:
        raise SettingsError("--usb-wheel steers only a car that the cockpit has started itself")
    if options.recordings:
        block = read_replay(options.recordings, options.log_channel, language.listening())
        if options.export is not None:
            title = ", ".join(path.name for path in options.recordings)
            write_text(options.export, single_page(block, title))
            say(NAME, f"wrote {options.export}")
            return ExitStatus.OK
        return asyncio.run(_serve(options, None, block))
    if options.export is not None:
        raise SettingsError("--export needs a RECORDING")
    settings = bus_settings(options)
    if is_own:
        first = scenario_titled(options.scenario)
        traffic_of(settings, 1)  # a mistake in a database is reported before the address
        if options.usb_wheel is not None:
            open_wheel(options.usb_wheel)[1].close()
        lanes = OwnLanes(options.bus, settings, language, options.usb_wheel)
        desk = Desk(lanes, None, "", may_control=True)
        return asyncio.run(_serve(options, desk, None, first))
    if not settings.is_quiet:
        raise SettingsError(f"{settings.description}: only the cockpit's own bus has these")
    opened = open_port(options)
    lane = Lane(opened.port, time.monotonic_ns(), listening=language.listening())
    desk = Desk(None, lane, opened.description, may_control=options.allow_control)
    return asyncio.run(_serve(options, desk, None))


async def _serve(
    options: argparse.Namespace,
    desk: Desk | None,
    block: bytes | None,
    first: Scenario | None = None,
) -> int:
    """Serve until a signal ends it, with a scenario to begin with where the programs are ours."""
    token = secrets.token_urlsafe(16)
    end = asyncio.Event()
    loop = asyncio.get_running_loop()
    with ending_signals(lambda *_signal: loop.call_soon_threadsafe(end.set)):
        try:
            async with serving(Server(token, desk, block), HOST, options.port) as port:
                address = f"http://{HOST}:{port}/{token}/"
                say(NAME, f"open {address}")
                if options.browser:
                    await asyncio.to_thread(webbrowser.open, address)
                if desk is not None and first is not None:
                    await desk.start(first)
                await end.wait()
        finally:
            if desk is not None:
                await desk.close()
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
