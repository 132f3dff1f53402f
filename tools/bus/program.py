"""The program ``steer-by-wire bus``: runs a broker until SIGINT, SIGTERM or SIGHUP.

Prints a line to standard output when clients can connect, and to standard error a line for every
client that it disconnects, and one with the statistics at the end. Exit status: 0 after an orderly
end, 2 for wrong arguments or settings, 3 if it cannot listen, 4 if the report cannot be written,
130 if it is interrupted before it listens.
"""

import argparse
import select
import signal
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

from ...runtime.command_line import command_parser, whole_number
from ...runtime.emulated_bus.address import (
    Address,
    AddressError,
    TcpAddress,
    default_address,
    group_number,
    listening,
    parse_address,
)
from ...runtime.emulated_bus.broker import Broker
from ...runtime.emulated_bus.broker_report import broker_report, summary_line
from ...runtime.emulated_bus.channel import ChannelConditions, client_number
from ...runtime.emulated_bus.journal import Journal
from ...runtime.program.bus_options import add_error_arguments, add_traffic_arguments, bus_settings
from ...runtime.program.host import RealTimeRequest, real_time
from ...runtime.program.option_types import bit_rate, data_bit_rate, output_file, priority
from ...runtime.settings import SettingsError

NAME = "steer-by-wire bus"
_WRONG_SETTINGS = 2
_CANNOT_LISTEN = 3
_CANNOT_WRITE = 4
_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    options = _parse(arguments)
    # All end the program through its finally clauses. SIGINT is set too, because a shell ignores it
    # for background programs. SIGHUP stays ignored below nohup.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.default_int_handler)
    try:
        conditions = _conditions(options)
        address = parse_address(options.address) if options.address else default_address()
        group = None if options.group is None else group_number(options.group)
        with listening(address, group) as listener:
            _serve(listener, address, options, conditions)
    except SettingsError as error:
        for mistake in error.mistakes:
            print(f"{NAME}: error: {mistake}", file=sys.stderr)
        return _WRONG_SETTINGS
    except AddressError as error:
        print(f"{NAME}: error: {error}", file=sys.stderr)
        return _CANNOT_LISTEN
    except OSError as error:
        print(f"{NAME}: error: {options.report}: {error.strerror}", file=sys.stderr)
        return _CANNOT_WRITE
    except KeyboardInterrupt:  # before or after it has listened
        return _INTERRUPTED
    return 0


def _conditions(options: argparse.Namespace) -> ChannelConditions:
    settings = bus_settings(options)
    for client in settings.receiver_bit_error_rate:
        try:
            client_number(client)
        except ValueError as error:
            raise SettingsError(f"receiver_bit_error_rate.{client}: {error}") from error
    if not settings.has_traffic:
        return ChannelConditions(settings, (), options.seed)
    # Not at the top: it imports cantools, which takes longer than all the rest.
    from ...closed_loop.rest_bus_messages import traffic_of

    return ChannelConditions(settings, traffic_of(settings, options.seed), options.seed)


def _serve(
    listener: socket.socket,
    address: Address,
    options: argparse.Namespace,
    conditions: ChannelConditions,
) -> None:
    """Serve until a signal or the end of standard input; raises OSError for the report."""
    if isinstance(address, TcpAddress):
        address = TcpAddress(*listener.getsockname())
    bitrate_bit_s = conditions.settings.bitrate_bit_s
    rates = f"{bitrate_bit_s} bit/s"
    if options.data_bitrate is not None:
        rates += f", CAN FD data at {options.data_bitrate} bit/s"
    journal = Journal(_print_line, options.verbose)
    broker = Broker(
        listener,
        bitrate_bit_s,
        options.data_bitrate,
        journal,
        takes_bus_off=options.allow_bus_off,
        is_fifo=options.fifo,
        conditions=conditions,
    )
    start_ns = time.monotonic_ns()
    print(f"{NAME}: listening at {address}, {rates}", flush=True)
    with suppress(KeyboardInterrupt), real_time(RealTimeRequest(options.priority)):
        broker.run(sys.stdin.fileno() if options.end_with_stdin else None)
    report = broker_report(broker, journal, time.monotonic_ns() - start_ns)
    _print_line(summary_line(report))
    if options.report is not None:
        # Not at the top: it imports python-can, which the broker does not need.
        from ...runtime.program.report import write_json

        write_json(options.report, report)


def _print_line(line: str) -> bool:
    """Print a line to standard error if that does not block; returns whether it was printed.

    A pipe that nobody reads becomes full and must not stop the bus. A writable pipe has room for
    PIPE_BUF bytes, more than a line has.
    """
    try:
        if not select.select((), [sys.stderr], (), 0.0)[1]:
            return False
        print(f"{NAME}: {line}", file=sys.stderr, flush=True)
    except (OSError, ValueError):
        return False
    return True


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = command_parser(
        NAME,
        "Run a CAN bus between processes, with bit-accurate timing and without CAN hardware.",
        NAME,
    )
    parser.add_argument(
        "--address",
        metavar="PATH|127.0.0.1:PORT",
        help="Unix socket or loopback port to listen at (default: this user's own)",
    )
    parser.add_argument("--group", metavar="NAME", help="let users of this group join too")
    parser.add_argument(
        "--bitrate",
        type=bit_rate,
        metavar="BIT_S",
        help="bit rate of every channel (default: 500000)",
    )
    parser.add_argument(
        "--data-bitrate",
        type=data_bit_rate,
        metavar="BIT_S",
        help="bit rate of the data phase; allows CAN FD",
    )
    parser.add_argument(
        "--allow-bus-off",
        action="store_true",
        help="let clients put each other into bus-off, as steer-by-wire faults inject does",
    )
    parser.add_argument(
        "--fifo",
        action="store_true",
        help="send each client's frames in their order, as a SocketCAN interface does "
        "(default: a transmit buffer for each identifier)",
    )
    parser.add_argument(
        "--end-with-stdin",
        action="store_true",
        help="end when standard input is closed, as when the parent ends",
    )
    parser.add_argument(
        "--priority",
        type=priority,
        default=50,
        metavar="0..99",
        help="SCHED_FIFO priority, if the host grants it (default: %(default)s)",
    )
    parser.add_argument(
        "--report", type=output_file, metavar="FILE", help="write a report at the end, JSON"
    )
    parser.add_argument(
        "--verbose", action="store_true", help="also print clients that join and leave in order"
    )
    add_traffic_arguments(parser)
    add_error_arguments(parser, "the client of this number")
    parser.add_argument(
        "--seed",
        type=whole_number(0, 2**63 - 1),
        default=1,
        metavar="N",
        help="seed of rest bus and noise (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    if options.group is not None and options.address is None:
        parser.error("--group needs --address: the default one is in a directory of its user alone")
    return options
