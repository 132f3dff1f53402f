"""The monitor as a program: its ends, the terminal after, and where there is none."""

import os
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from tests.support.programs.running_program import PATIENCE_S


@pytest.fixture
def broker() -> Iterator[str]:
    with launched_broker() as address:
        yield address


def bus_options(address: str) -> list[str]:
    return ["-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={address}"]


class OnTerminal:
    """The monitor on a terminal of 80 columns and 24 lines."""

    def __init__(self, options: list[str]) -> None:
        import fcntl
        import pty
        import struct
        import termios

        self.master, self.terminal = pty.openpty()
        size = struct.pack("HHHH", 24, 80, 0, 0)
        fcntl.ioctl(self.terminal, termios.TIOCSWINSZ, size)
        self.before = termios.tcgetattr(self.terminal)
        self.shown = b""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "steer_by_wire.tools.monitor", *options],
            stdin=self.terminal,
            stdout=self.terminal,
            stderr=self.terminal,
            env={**os.environ, "TERM": "xterm-256color", "PYTHONIOENCODING": "utf-8"},
            start_new_session=True,
        )

    def wait_for(self, text: bytes) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while text not in self.shown:
            assert time.monotonic() < until_s, f"{text!r} is not shown: {self.shown[-2000:]!r}"
            if select.select([self.master], [], [], 0.1)[0]:
                self.shown += os.read(self.master, 1 << 16)

    def end(self) -> int:
        until_s = time.monotonic() + PATIENCE_S
        while self.process.poll() is None:  # who does not read holds it up
            assert time.monotonic() < until_s, "it does not end"
            if select.select([self.master], [], [], 0.1)[0]:
                self.shown += os.read(self.master, 1 << 16)
        while select.select([self.master], [], [], 0.0)[0]:
            self.shown += os.read(self.master, 1 << 16)
        return self.process.returncode

    def is_as_before(self) -> bool:
        """Whether the terminal has its modes, its screen and its cursor back."""
        import termios

        return (
            termios.tcgetattr(self.terminal) == self.before
            and self.shown.rfind(b"\x1b[?1049l") > self.shown.rfind(b"\x1b[?1049h") >= 0
            and self.shown.rfind(b"\x1b[?25h") > self.shown.rfind(b"\x1b[?25l") >= 0
        )

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self.master)
        os.close(self.terminal)


@pytest.fixture
def on_terminal(broker: str) -> Iterator[OnTerminal]:
    if sys.platform == "win32":
        pytest.skip("Windows has no pseudo terminals of this kind")
    monitor = OnTerminal(bus_options(broker))
    yield monitor
    monitor.close()


def test_it_shows_what_is_on_the_bus(broker: str, on_terminal: OnTerminal) -> None:
    with can.Bus(interface="emulated", channel="can0", address=broker) as bus:
        on_terminal.wait_for(b"refused: ")
        bus.send(can.Message(arbitration_id=0x7E5, data=b"\1", is_extended_id=False))
        on_terminal.wait_for(b"(7E5)")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_gives_the_terminal_back(on_terminal: OnTerminal, number: signal.Signals) -> None:
    on_terminal.wait_for(b"refused: ")
    on_terminal.process.send_signal(number)
    assert on_terminal.end() == 0
    assert on_terminal.is_as_before()


def test_a_bus_that_fails_gives_the_terminal_back_and_is_one_line() -> None:
    if sys.platform == "win32":
        pytest.skip("Windows has no pseudo terminals of this kind")
    with launched_broker() as address:
        monitor = OnTerminal(bus_options(address))
        try:
            monitor.wait_for(b"refused: ")
        except BaseException:
            monitor.close()
            raise
    try:
        assert monitor.end() == 3
        assert monitor.is_as_before()
        after = monitor.shown[monitor.shown.rfind(b"\x1b[?1049l") :].decode()
        assert len(re.findall(r"monitor: error: .*", after)) == 1
    finally:
        monitor.close()


def test_without_a_terminal_it_prints_line_by_line(broker: str) -> None:
    command = [sys.executable, "-m", "steer_by_wire.tools.monitor", *bus_options(broker)]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as monitor:
        assert monitor.stdout is not None
        assert monitor.stderr is not None
        assert "Ctrl-C ends it" in monitor.stderr.readline()
        lines = [monitor.stdout.readline() for _ in range(2)]
        monitor.send_signal(signal.SIGINT)
        assert monitor.wait(PATIENCE_S) == 0
    assert all(re.match(r"\d+\.\d s  -  error - mm", line) for line in lines)
