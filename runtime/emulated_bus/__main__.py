"""The program ``emulated-can-bus``: runs a broker until SIGINT or SIGTERM.

Prints one line to standard output when clients can connect, and one with the statistics to
standard error at the end. Exit status: 0 after an orderly end, 2 for wrong arguments, 3 when it
cannot listen.
"""

import argparse
import logging
import signal
import socket
import sys
import time
from collections.abc import Sequence

from runtime.bus_model import BusLoad
from runtime.emulated_bus.address import (
    Address,
    AddressError,
    TcpAddress,
    default_address,
    listening,
    parse_address,
)
from runtime.emulated_bus.broker import Broker
from runtime.host import RealTimeRequest, real_time
from runtime.option_types import priority

_NAME = "emulated-can-bus"
_CANNOT_LISTEN = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(
        format=f"{_NAME}: %(message)s", level=logging.INFO if options.verbose else logging.WARNING
    )
    # Both end the program through its finally clauses. SIGINT is set too because a shell starts
    # background programs with it ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        address = parse_address(options.address) if options.address else default_address()
        with listening(address) as listener:
            _serve(listener, address, options)
    except AddressError as error:
        print(f"{_NAME}: {error}", file=sys.stderr)
        return _CANNOT_LISTEN
    except KeyboardInterrupt:
        pass
    return 0


def _serve(listener: socket.socket, address: Address, options: argparse.Namespace) -> None:
    """Serve until the end; a KeyboardInterrupt is passed on."""
    if isinstance(address, TcpAddress):
        address = TcpAddress(*listener.getsockname())
    rates = f"{options.bitrate} bit/s"
    if options.data_bitrate is not None:
        rates += f", CAN FD data at {options.data_bitrate} bit/s"
    broker = Broker(listener, options.bitrate, options.data_bitrate)
    start_ns = time.monotonic_ns()
    print(f"{_NAME}: listening at {address}, {rates}", flush=True)
    try:
        with real_time(RealTimeRequest(options.priority)):
            broker.run(sys.stdin.fileno() if options.end_with_stdin else None)
    finally:
        duration_ns = time.monotonic_ns() - start_ns
        print(f"{_NAME}: {_statistics(broker.loads, duration_ns)}", file=sys.stderr)


def _statistics(loads: dict[str, BusLoad], duration_ns: int) -> str:
    """Return one line on what the channels have carried in ``duration_ns``."""
    channels = [
        f"{name} {load.frames} frames, load {load.busy_ns / duration_ns:.1%}"
        for name, load in sorted(loads.items())
    ]
    return "; ".join([f"ran {duration_ns * 1e-9:.1f} s", *channels])


def _parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog=_NAME,
        description="CAN bus between processes for python-can's interface 'emulated': frames take "
        "their exact time on the wire and compete by identifier.",
    )
    parser.add_argument(
        "--address",
        metavar="PATH|127.0.0.1:PORT",
        help="Unix socket or loopback port to listen at (default: a socket of this user's own)",
    )
    parser.add_argument(
        "--bitrate",
        type=_nominal_bit_rate,
        default=500_000,
        metavar="BIT_S",
        help="bit rate of every channel (default: %(default)s)",
    )
    parser.add_argument(
        "--data-bitrate",
        type=_data_bit_rate,
        metavar="BIT_S",
        help="bit rate of the data phase; lets clients use CAN FD (default: classic CAN only)",
    )
    parser.add_argument(
        "--end-with-stdin",
        action="store_true",
        help="end when standard input is closed: a program that starts a bus of its own holds the "
        "other end, so that none is left behind when it dies",
    )
    parser.add_argument(
        "--priority",
        type=priority,
        default=50,
        metavar="0..99",
        help="SCHED_FIFO priority, as far as the host grants it; 0 does not ask for it "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--verbose", action="store_true", help="also log clients that come and go in order"
    )
    return parser


def _nominal_bit_rate(text: str) -> int:
    return _bit_rate(text, 1_000_000)


def _data_bit_rate(text: str) -> int:
    return _bit_rate(text, 8_000_000)


def _bit_rate(text: str, highest_bit_s: int) -> int:
    """Read a bit rate as ISO 11898 allows it, from 10 kbit/s; raises ArgumentTypeError."""
    if not text.isdecimal() or not 10_000 <= int(text) <= highest_bit_s:
        raise argparse.ArgumentTypeError(f"{text!r} is not between 10000 and {highest_bit_s} bit/s")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
