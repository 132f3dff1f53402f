"""Runs a private broker as a child process."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from subprocess import PIPE
from typing import IO

from .attached import Lifeline

AFTER_S = 1.0
"""How long the broker outlives a killed parent, so that its clients end first."""


@contextmanager
def launched_broker(options: Sequence[str] = (), log: IO[str] | None = None) -> Iterator[str]:
    """Run a broker with command line ``options`` until the end of the block.

    ``log``  for its statistics and messages; standard error unless given

    Yields its address, a socket in a private directory, when clients can connect. Broker and
    directory go with this process, however that ends. Raises RuntimeError if the broker does not
    start, after it has printed the reason on standard error.
    """
    with (
        tempfile.TemporaryDirectory(prefix="emulated-can-bus-") as directory,
        closing(Lifeline()) as line,
    ):
        address = str(Path(directory) / "socket")
        arguments = ["--address", address, *options]
        broker = line.start(
            "steer_by_wire.tools.bus", arguments, PIPE, log, after_s=AFTER_S, remove=Path(directory)
        )
        with broker:  # ends with waiting for it
            if broker.stdout is None or not broker.stdout.readline():
                raise RuntimeError("the broker of the emulated bus has not started")
            try:
                yield address
            finally:
                broker.terminate()
