"""Bus-off on the emulated bus: what its client and the others see, and when it ends.

The broker is stepped by hand on a fake clock; the last test runs a real one.
"""

import socket
from collections.abc import Iterator
from contextlib import ExitStack

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.runtime.bus_model.bus_model import BusLoad
from steer_by_wire.runtime.bus_model.socketcan_error_frames import BUS_OFF, RESTARTED, error_causes
from steer_by_wire.runtime.emulated_bus.broker_report import broker_report, summary_line
from steer_by_wire.runtime.emulated_bus.bus_off_recovery import SEQUENCE_BITS, SEQUENCES, Recovery
from steer_by_wire.runtime.emulated_bus.journal import Cause
from steer_by_wire.runtime.emulated_bus.protocol import (
    BUS_OFF_NS_MAX,
    CLASSIC_RECORD,
    BusOff,
    ProtocolError,
    pack_bus_off,
    unpack_request,
)
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from tests.support.programs.broker_bench import BITRATE_BIT_S, Bench, received, send
from tests.support.programs.running_program import PATIENCE_S

BIT_NS = NS_PER_S // BITRATE_BIT_S
RECOVERY_NS = SEQUENCES * SEQUENCE_BITS * BIT_NS
"""2.816 ms: of an idle bus."""
STEP_NS = 10_000
COMMAND, OTHER = Frame(0x100, b"command"), Frame(0x110, b"other")


class Table(Bench):
    """A broker with three clients: a node, its peer, and one that asks for the node's bus-off."""

    def __init__(self, stack: ExitStack, *, takes_bus_off: bool = True) -> None:
        super().__init__(stack, takes_bus_off=takes_bus_off)
        self.node, self.peer, self.asking = self.join(), self.join(), self.join()

    def advance(self, duration_ns: int, step_ns: int = STEP_NS) -> None:
        super().advance(duration_ns, step_ns)

    def send(self, client: socket.socket, *frames: Frame) -> None:
        send(client, *frames)
        self.step()

    def send_off(self, can_id: int = 0x100, restart_after_ns: int = 0) -> None:
        self.asking.sendall(pack_bus_off(CLASSIC_RECORD, BusOff(can_id, False, restart_after_ns)))
        self.step()

    def causes(self, client: socket.socket) -> list[str]:
        frames = [frame for frame in received(client) if frame.flags & ERROR]
        return [cause for frame in frames for cause in error_causes(frame)]


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


@pytest.fixture
def table(stack: ExitStack) -> Table:
    table = Table(stack)
    table.send(table.node, COMMAND)
    table.advance(NS_PER_MS)
    assert received(table.peer) == [COMMAND]
    return table


def test_a_node_in_bus_off_is_reported_and_neither_sends_nor_hears(table: Table) -> None:
    table.send_off(restart_after_ns=50 * NS_PER_MS)
    assert table.causes(table.node) == [BUS_OFF]
    table.send(table.node, COMMAND, COMMAND)
    table.send(table.peer, OTHER)
    table.advance(10 * NS_PER_MS)
    assert received(table.peer) == []
    assert received(table.node) == []
    assert received(table.asking) == [COMMAND, OTHER], "all others go on"
    channel = table.broker.channels["can0"]
    assert (channel.bus_offs, channel.lost_in_bus_off) == (1, 2)


def test_on_an_idle_bus_it_is_back_1408_bits_after_its_restart_and_not_before(table: Table) -> None:
    table.send_off(restart_after_ns=50 * NS_PER_MS)
    assert table.causes(table.node) == [BUS_OFF]
    table.advance(50 * NS_PER_MS + RECOVERY_NS - STEP_NS)
    assert table.causes(table.node) == []
    table.send(table.node, COMMAND)
    table.advance(2 * STEP_NS)
    assert table.causes(table.node) == [RESTARTED]
    assert received(table.peer) == [], "what was sent before is lost"
    table.send(table.node, COMMAND)
    table.advance(NS_PER_MS)
    assert received(table.peer) == [COMMAND]


def test_on_a_full_bus_it_needs_128_frames_of_others(table: Table) -> None:
    frame = Frame(0x000, bytes(8))
    frame_ns = (frame_bits(frame).nominal + INTERMISSION_BITS) * BIT_NS
    table.send(table.peer, *[frame] * 60)
    table.send_off()
    assert table.causes(table.node) == [BUS_OFF]
    lasted_ns = 0
    while table.causes(table.node) != [RESTARTED]:
        table.advance(frame_ns)
        table.send(table.peer, frame)
        lasted_ns += frame_ns
        assert lasted_ns < 200 * frame_ns
    assert SEQUENCES - 2 <= lasted_ns / frame_ns <= SEQUENCES + 14, "one frame may be half counted"


def test_its_frames_that_wait_for_the_wire_are_lost_and_its_place_is_free(table: Table) -> None:
    table.send(table.peer, *[Frame(0x000, bytes(8))] * 10)
    table.send(table.node, *[COMMAND] * 64)
    table.send_off()
    channel = table.broker.channels["can0"]
    assert channel.lost_in_bus_off == 64
    table.advance(20 * NS_PER_MS)
    assert table.causes(table.node)[-1] == RESTARTED
    table.send(table.node, *[COMMAND] * 64)
    table.advance(30 * NS_PER_MS)
    assert received(table.peer) == [COMMAND] * 64


def test_a_second_request_starts_it_earlier_and_never_later(table: Table) -> None:
    table.send_off(restart_after_ns=50 * NS_PER_MS)
    table.send_off(restart_after_ns=90 * NS_PER_MS)
    table.advance(10 * NS_PER_MS)
    table.send_off()
    table.advance(RECOVERY_NS + STEP_NS)
    assert table.causes(table.node) == [BUS_OFF, RESTARTED]
    assert table.broker.channels["can0"].bus_offs == 1


def test_an_identifier_that_nobody_has_sent_or_whose_sender_has_gone_is_nobodys(
    table: Table,
) -> None:
    table.send_off(0x777)
    table.node.close()
    table.step()
    table.send_off()
    table.advance(NS_PER_MS)
    assert table.broker.channels["can0"].bus_offs == 0


def test_a_node_may_leave_in_bus_off(table: Table) -> None:
    table.send(table.node, *[COMMAND] * 10)
    table.send_off()
    table.node.close()
    table.advance(10 * NS_PER_MS)
    table.send(table.peer, OTHER)
    table.advance(NS_PER_MS)
    assert OTHER in received(table.asking)


def test_a_broker_that_does_not_allow_it_disconnects_who_asks(stack: ExitStack) -> None:
    table = Table(stack, takes_bus_off=False)
    assert not table.answer.takes_bus_off
    table.send(table.node, COMMAND)
    table.send_off()
    assert table.journal.disconnections[Cause.REFUSED] == 1
    assert "requests a bus-off, which this bus does not allow" in table.lines[-1]
    table.advance(NS_PER_MS)
    assert received(table.node) == [], "and nothing happens"


def test_the_journal_and_the_report_contain_it(table: Table) -> None:
    table.send_off()
    table.advance(10 * NS_PER_MS)
    assert "client 1 of 'can0'" in table.lines[0]
    assert "is in bus-off: requested by client 3" in table.lines[0]
    assert "is back from bus-off" in table.lines[1]
    report = broker_report(table.broker, table.journal, NS_PER_S)
    assert report["channels"]["can0"]["bus_offs"] == 1
    assert "1x bus-off" in summary_line(report)


def test_a_request_is_taken_up_to_its_longest_time_and_not_beyond() -> None:
    for request in (BusOff(0x100, False, 0), BusOff(0x1FFF_FFFF, True, BUS_OFF_NS_MAX)):
        assert unpack_request(CLASSIC_RECORD, pack_bus_off(CLASSIC_RECORD, request)) == request
    for wrong_ns in (-1, BUS_OFF_NS_MAX + 1):
        raw = pack_bus_off(CLASSIC_RECORD, BusOff(0x100, False, wrong_ns))
        with pytest.raises(ProtocolError):
            unpack_request(CLASSIC_RECORD, raw)


def test_a_recovery_sees_a_frame_and_eleven_idle_bits_each_as_one_sequence() -> None:
    recovery = Recovery(restart_ns=1000, bitrate_bit_s=BITRATE_BIT_S)
    assert not recovery.is_over(999, BusLoad(7, 100, 0), 999)
    assert not recovery.is_over(1000, BusLoad(7, 100, 0), 1000)
    busy_ns = 500_000
    idle_ns = (SEQUENCES - 2) * SEQUENCE_BITS * BIT_NS
    load = BusLoad(9, 100 + busy_ns, 0)
    quiet_ns = 1000 + busy_ns + idle_ns
    assert not recovery.is_over(quiet_ns - 1, load, quiet_ns - 1)
    assert recovery.is_over(quiet_ns, load, quiet_ns)


def test_a_client_of_python_can_asks_is_notified_through_its_filters_and_is_refused() -> None:
    with launched_broker(["--allow-bus-off"]) as address, launched_broker() as other:
        arguments = {"interface": "emulated", "channel": "can0"}
        with (
            can.Bus(**arguments, address=address) as bus,
            can.Bus(**arguments, address=other) as forbidden,
        ):
            bus.set_filters([{"can_id": 0x7, "can_mask": 0x7FF, "extended": False}])
            bus.send(can.Message(arbitration_id=0x100, is_extended_id=False))
            bus.send_bus_off(0x100, 0.01)
            reported = [bus.recv(PATIENCE_S), bus.recv(PATIENCE_S)]
            assert [one and (one.is_error_frame, one.arbitration_id) for one in reported] == [
                (True, 0x40),
                (True, 0x100),
            ]
            with pytest.raises(can.CanOperationError, match="--allow-bus-off"):
                forbidden.send_bus_off(0x100, 0.0)
