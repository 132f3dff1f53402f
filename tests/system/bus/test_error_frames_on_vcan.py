"""Error frames of our bus model as ``candump -e`` of can-utils reads them."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.virtual_bus import SharedBus
from steer_by_wire.runtime.bus_model.bus_errors import ErrorEvent
from steer_by_wire.runtime.bus_model.fault_confinement import ControllerState
from steer_by_wire.runtime.bus_model.settings import BusSettings, errors_of
from steer_by_wire.runtime.bus_model.socketcan_error_frames import error_frame
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.port.socketcan import SocketCanPort
from tests.support.programs.running_program import PATIENCE_S, wait_until

pytestmark = pytest.mark.vcan

CHANNEL = "vcan0"
STATES = {
    ControllerState.ERROR_WARNING: ("warning", 96),
    ControllerState.ERROR_PASSIVE: ("passive", 128),
}
"""candump's word for a state, and from which count on."""


def events() -> Iterator[ErrorEvent]:
    """The errors that lead to a new state, and one that does not, on a bus full of errors."""
    errors = errors_of(BusSettings(bit_error_rate=0.01), 3)
    assert errors is not None
    found: list[ErrorEvent] = []
    errors.on_error = found.append
    bus = SharedBus(500_000, errors=errors)
    errors.join(1)
    for number in range(2000):
        bus.submit(Frame(0x200 + number % 7, number.to_bytes(4)), 0, number * 500_000)
        bus.advance(number * 500_000)
    while bus.next_event_ns < NEVER_NS:
        bus.advance(bus.next_event_ns)
    seen = set()
    for event in found:
        state = event.state if event.has_changed else None
        if state not in seen:
            seen.add(state)
            yield event


def words_of(event: ErrorEvent) -> set[str]:
    """What candump should say of an error to its sender."""
    sent = min(event.transmit_errors, 255)
    words = {
        f"error-counter-tx-rx{{{{{sent}}}{{{event.receive_errors}}}}}",
        "protocol-violation{{single-bit-error}{}}",
        "bus-error",
    }
    if event.has_changed and event.state is ControllerState.BUS_OFF:
        words.add("bus-off")
    elif event.has_changed:
        state, low = STATES[event.state]
        counters = {"rx": event.receive_errors, "tx": event.transmit_errors}
        sides = [f"{side}-error-{state}" for side, count in counters.items() if count >= low]
        words.add(f"controller-problem{{{','.join(sides)}}}")
    return words


def dumped(frames: list[Frame], log: Path) -> list[set[str]]:
    """Send frames on the interface; returns candump's words on each."""
    with log.open("w") as output:
        candump = subprocess.Popen(
            ["candump", "-e", "-n", str(len(frames)), f"{CHANNEL},#FFFFFFFF"],
            stdout=output, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            listening = Path("/proc/net/can/rcvlist_err")
            wait_until(
                lambda: (
                    re.search(rf"^\s*{CHANNEL}\s+\w", listening.read_text(), re.MULTILINE)
                    is not None
                ),
                "candump to listen",
            )
            port = SocketCanPort(CHANNEL)
            for frame in frames:
                assert port.send(frame)
            assert candump.wait(PATIENCE_S) == 0
            port.shutdown()
        finally:
            candump.kill()
            candump.wait()
    text = log.read_text()
    reports = re.split(rf"^ *{CHANNEL} ", text, flags=re.MULTILINE)[1:]
    assert len(reports) == len(frames), text
    return [
        {line.strip() for line in report.splitlines() if line.strip()[-10:] != "ERRORFRAME"}
        for report in reports
    ]


@pytest.mark.skipif(shutil.which("candump") is None, reason="needs can-utils")
def test_candump_reads_in_our_error_frames_what_was_meant(tmp_path: Path) -> None:
    sent = list(events())
    assert {event.state for event in sent if event.has_changed} >= {
        *STATES,
        ControllerState.BUS_OFF,
    }
    frames = [error_frame(event) for event in sent]
    assert dumped(frames, tmp_path / "candump.txt") == [words_of(event) for event in sent]
