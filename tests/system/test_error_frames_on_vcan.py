"""What ``candump -e`` of can-utils reads in the error frames of our bus model."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.virtual_bus import SharedBus
from steer_by_wire.runtime.bus_model.bus_errors import ErrorEvent
from steer_by_wire.runtime.bus_model.fault_confinement import ControllerState, ErrorCounters
from steer_by_wire.runtime.bus_model.settings import BusSettings, StuckSettings, errors_of
from steer_by_wire.runtime.bus_model.socketcan_error_frames import (
    BUS_OFF_FRAME,
    RESTARTED_FRAME,
    error_frame,
    receiver_error_frame,
    state_frame,
)
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.port.socketcan import SocketCanPort
from tests.support.programs.running_program import PATIENCE_S, wait_until

pytestmark = pytest.mark.vcan

CHANNEL = "vcan0"
PLACES = {
    "SOF": "start-of-frame", "ID": "id.28-to-id.21", "SRR": "bit-srtr", "IDE": "bit-ide",
    "ID extension": "id.17-to-id.13", "RTR": "bit-rtr", "r1": "reserved-bit-1",
    "r0": "reserved-bit-0", "DLC": "data-length-code", "data": "data-field",
    "CRC": "crc-sequence", "CRC delimiter": "crc-delimiter", "ACK": "acknowledge-slot",
    "ACK delimiter": "acknowledge-delimiter", "EOF": "end-of-frame",
}  # fmt: skip
"""candump's words, by the field's name in ISO 11898-1."""
STATES = {
    ControllerState.ERROR_WARNING: ("warning", 96),
    ControllerState.ERROR_PASSIVE: ("passive", 128),
}
"""candump's word for a state, and from which count on."""


def events() -> Iterator[ErrorEvent]:
    """Errors of all kinds, each once: a bus full of errors, in the middle of which it is stuck."""
    stuck = StuckSettings(level="dominant", start_s=0.5, end_s=0.51)
    errors = errors_of(
        BusSettings(bit_error_rate=0.01, stuck=(stuck,)), 3, int, lambda _sender: True
    )
    assert errors is not None
    found: list[ErrorEvent] = []
    errors.on_error = found.append
    bus = SharedBus(500_000, errors=errors)
    errors.join(1)
    for number in range(2000):
        flags = EXTENDED * (number % 2)
        bus.submit(Frame(0x200 + number % 7, number.to_bytes(4), flags), 0, number * 500_000)
        bus.advance(number * 500_000)
    while bus.next_event_ns < NEVER_NS:
        bus.advance(bus.next_event_ns)
    seen = set()
    for event in found:
        kind = (event.cause, event.field, event.state if event.has_changed else None)
        if kind not in seen:
            seen.add(kind)
            yield event


def words_of(event: ErrorEvent) -> set[str]:
    """What candump should say of an error to its sender."""
    words = {f"error-counter-tx-rx{{{{{event.transmit_errors}}}{{{event.receive_errors}}}}}"}
    if event.transmit_errors >= 256:
        words = {f"error-counter-tx-rx{{{{255}}{{{event.receive_errors}}}}}"}
    if event.cause == "arbitration lost":
        words.add("lost-arbitration{at bit 0}")
    else:
        words |= {
            f"protocol-violation{{{{single-bit-error}}{{{PLACES[event.field]}}}}}", "bus-error"
        }  # fmt: skip
    if event.field == "ACK":
        words.add("no-acknowledgement-on-tx")
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
    fields = {event.field for event in sent}
    assert {"ID", "DLC", "data", "CRC", "ACK", "EOF", "ID extension"} <= fields
    assert {event.state for event in sent} >= {*STATES, ControllerState.BUS_OFF}
    assert "arbitration lost" in {event.cause for event in sent}
    counters = ErrorCounters()
    counters.receive = 130
    other = next(event for event in sent if event.field == "data")
    frames = [error_frame(event) for event in sent]
    frames += [
        receiver_error_frame(other, counters, has_changed=True),
        state_frame(counters),
        state_frame(ErrorCounters()),
        BUS_OFF_FRAME,
        RESTARTED_FRAME,
    ]
    wanted = [words_of(event) for event in sent]
    wanted += [
        {
            "controller-problem{rx-error-passive}",
            "protocol-violation{{}{data-field}}",
            "bus-error",
            "error-counter-tx-rx{{0}{130}}",
        },
        {"controller-problem{rx-error-passive}", "error-counter-tx-rx{{0}{130}}"},
        {"controller-problem{back-to-error-active}"},
        {"bus-off"},
        {"restarted-after-bus-off"},
    ]
    assert dumped(frames, tmp_path / "candump.txt") == wanted
