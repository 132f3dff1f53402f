"""Runs a private broker as a child process, for programs that bring their own bus."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from subprocess import PIPE
from typing import IO

from ..attached import lifeline

AFTER_S = 1.0
"""How long the broker outlasts a program that was ended: its clients end before their bus."""


@contextmanager
def launched_broker(options: Sequence[str] = (), log: IO[str] | None = None) -> Iterator[str]:
    """Run a broker with the command line ``options`` until the end of the block.

    ``log``  what takes its statistics and complaints; standard error unless given

    Yields its address, a socket in a private directory, when clients can connect. The broker and
    the directory end with this process too, in whatever way that ends. Raises RuntimeError when it
    does not start; it has reported why on standard error.
    """
    with tempfile.TemporaryDirectory(prefix="emulated-can-bus-") as directory, lifeline() as line:
        address = str(Path(directory) / "socket")
        arguments = ["--address", address, *options]
        broker = line.start(
            "steer_by_wire.runtime.emulated_bus",
            arguments,
            PIPE,
            log,
            after_s=AFTER_S,
            remove=Path(directory),
        )
        with broker:  # ends with waiting for it
            if broker.stdout is None or not broker.stdout.readline():
                raise RuntimeError("the broker of the emulated bus has not started")
            try:
                yield address
            finally:
                broker.terminate()
