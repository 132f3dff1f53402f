"""Runs a broker of one's own as a child process, for programs that bring their bus along."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def launched_broker(options: Sequence[str] = (), log: IO[str] | None = None) -> Iterator[str]:
    """Run a broker with the command line ``options`` until the end of the block.

    ``log``  what takes its statistics and complaints; standard error unless given

    Yields its address, a socket in a private directory, when clients can connect. The broker ends
    with this process too, in whatever way that ends. Raises RuntimeError when it does not start;
    it has said why on standard error.
    """
    with tempfile.TemporaryDirectory(prefix="emulated-can-bus-") as directory:
        address = str(Path(directory) / "socket")
        command = [sys.executable, "-m", "runtime.emulated_bus", "--address", address]
        broker = subprocess.Popen(  # noqa: S603 the command is our own
            [*command, "--end-with-stdin", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            start_new_session=True,  # Ctrl-C is for this process; the clients end before the bus.
        )
        # Popen's block ends with closing the broker's standard input and waiting for its end.
        with broker:
            if broker.stdout is None or not broker.stdout.readline():
                raise RuntimeError("the broker of the emulated bus has not started")
            yield address
