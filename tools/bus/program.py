"""The program ``steer-by-wire bus``: runs a broker until SIGINT, SIGTERM or SIGHUP.

Prints a line to standard output when clients can connect, and to standard error a line for every
client that it disconnects, and one with the statistics at the end. Exit status: 0 after an orderly
end, 2 for wrong arguments or settings, 3 if it cannot listen or serve, 130 if it is interrupted
before it listens.
"""

import argparse
import select
import signal
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from ...runtime.bus_model.rest_bus import NO_TRAFFIC, Traffic
from ...runtime.bus_model.settings import BusSettings
from ...runtime.command_line import command_parser, ending_signals, run_main, whole_number
from ...runtime.emulated_bus.address import (
    Address,
    AddressError,
    TcpAddress,
    default_address,
    listening,
    parse_address,
)
from ...runtime.emulated_bus.broker import Broker
from ...runtime.exit_status import ExitStatus, cause_of
from ...runtime.program.bus_options import (
    add_traffic_arguments,
    bit_rate,
    bus_settings,
    data_bit_rate,
)
from ...runtime.program.priority_and_memory_lock import priority, real_time

NAME = "steer-by-wire bus"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    return run_main(NAME, partial(_run, _parse(arguments)))


def _run(options: argparse.Namespace) -> ExitStatus:
    settings = bus_settings(options)
    traffic = _traffic(settings, options.seed)
    address = default_address() if options.address is None else parse_address(options.address)
    with listening(address) as listener:
        _serve(listener, address, options, settings.bitrate_bit_s, traffic)
    return ExitStatus.OK


def _traffic(settings: BusSettings, seed: int) -> Traffic:
    if not settings.has_traffic:
        return NO_TRAFFIC
    # Not at the top: it imports cantools, which takes longer than all the rest.
    from ...closed_loop.pair.rest_bus_from_dbc import traffic_of

    return Traffic(traffic_of(settings, seed), seed)


def _serve(
    listener: socket.socket,
    address: Address,
    options: argparse.Namespace,
    bitrate_bit_s: int,
    traffic: Traffic,
) -> None:
    """Serve until a signal or the end of standard input; raises AddressError if it has failed."""
    if isinstance(address, TcpAddress):
        address = TcpAddress(*listener.getsockname())
    rates = f"{bitrate_bit_s} bit/s"
    if options.data_bitrate is not None:
        rates += f", CAN FD data at {options.data_bitrate} bit/s"
    broker = Broker(listener, bitrate_bit_s, options.data_bitrate, _print_line, traffic=traffic)
    with _first_signal() as signalled:
        start_ns = time.monotonic_ns()
        print(f"{NAME}: listening at {address}, {rates}", flush=True)
        ends = [signalled, sys.stdin.fileno()] if options.end_with_stdin else [signalled]
        try:
            with real_time(options.priority):
                broker.run(ends)
        except OSError as error:
            raise AddressError(f"the bus at {address} has failed: {cause_of(error)}") from error
        finally:
            _print_line(broker.summary(time.monotonic_ns() - start_ns))


@contextmanager
def _first_signal() -> Iterator[int]:
    """Yield a descriptor that becomes readable with a signal that ends programs, within the block.

    The signal itself writes to it. Python's handler would not run before the broker's ``select``
    returns, which may be never, if the signal came just before that or to another thread.
    Terminals and wrappers may send a signal twice: the second one must not cost the report.
    """
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    with reader, writer, ending_signals(lambda *_signal: None):
        before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
        try:
            yield reader.fileno()
        finally:
            signal.set_wakeup_fd(before)


def _print_line(line: str) -> None:
    """Print a line to standard error if that does not block.

    A pipe without a reader becomes full and must not stop the bus. A writable pipe has room for
    PIPE_BUF bytes, more than a line has.
    """
    try:
        if select.select((), [sys.stderr], (), 0.0)[1]:
            print(f"{NAME}: {line}", file=sys.stderr, flush=True)
    except (OSError, ValueError):
        return


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
    parser.add_argument(
        "--bitrate", type=bit_rate, metavar="BIT_S",
        help="bit rate of every channel (default: 500000)",
    )  # fmt: skip
    parser.add_argument(
        "--data-bitrate", type=data_bit_rate, metavar="BIT_S",
        help="bit rate of the data phase; allows CAN FD",
    )  # fmt: skip
    parser.add_argument(
        "--end-with-stdin",
        action="store_true",
        help="end when standard input is closed, as when the parent ends",
    )
    parser.add_argument(
        "--priority", type=priority, default=50, metavar="0..99",
        help="SCHED_FIFO priority, if the host grants it (default: %(default)s)",
    )  # fmt: skip
    add_traffic_arguments(parser)
    parser.add_argument(
        "--seed", type=whole_number(0, 2**63 - 1), default=1, metavar="N",
        help="seed of the rest bus (default: %(default)s)",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    if options.end_with_stdin and sys.stdin is None:
        parser.error("--end-with-stdin: standard input is closed already")
    return options
