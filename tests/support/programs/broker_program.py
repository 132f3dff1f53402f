"""The program of the emulated bus, started as a user does, and its clients."""

import select
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import can
import pytest

from tests.support.programs.running_program import PATIENCE_S


@pytest.fixture
def directory() -> Iterator[Path]:
    """A directory with a short name: the path of a socket has 107 bytes at most."""
    with tempfile.TemporaryDirectory(prefix="bus-") as name:
        yield Path(name)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


def client(stack: ExitStack, address: str, **options: Any) -> can.BusABC:
    bus = can.Bus(interface="emulated", address=address, ignore_config=True, **options)
    stack.callback(bus.shutdown)
    return bus


def message(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def receive(bus: can.BusABC) -> can.Message:
    received = bus.recv(PATIENCE_S)
    assert received is not None, "a frame was lost"
    return received


def start_broker(stack: ExitStack, *options: str) -> subprocess.Popen[str]:
    """Start the program as a user does; returns it when it listens or has ended."""
    broker = stack.enter_context(
        subprocess.Popen(
            [sys.executable, "-m", "steer_by_wire.tools.bus", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
    )
    stack.callback(broker.kill)
    assert broker.stdout is not None
    select.select([broker.stdout], [], [], PATIENCE_S)
    return broker
