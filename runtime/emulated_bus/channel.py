"""One channel of the broker: a bus with its own time, and the clients on it.

Rest bus and errors are those of the bus model, as in virtual time; their time begins
with the channel. Such a channel is advanced every PACE_NS at least, so that frames of the traffic
reach the clients up to that much late, with their right times.
"""

from collections.abc import Sequence
from struct import Struct
from typing import NamedTuple

from ..bus_model.bus_model import BusLoad, BusModel, Delivery
from ..bus_model.fault_confinement import ControllerState
from ..bus_model.rest_bus import PeriodicMessage, RestBus
from ..bus_model.settings import BusSettings, errors_of
from ..bus_model.socketcan_error_frames import BUS_OFF_FRAME, RESTARTED_FRAME, state_of
from ..frame import ERROR, EXTENDED, Frame
from ..node import NEVER_NS, NS_PER_MS
from .arbitration_delays import WATCHED_IDS_MAX, ArbitrationDelays
from .broker_connection import Connection
from .bus_off_recovery import Recovery
from .departed_clients import DepartedClients
from .error_reports import ErrorReports
from .protocol import OWN, BusOff, pack_frame
from .transmit_buffers import FRAMES_WAITING_MAX, TransmitBuffers

PACE_NS = NS_PER_MS
"""How long a channel with traffic or errors is left alone at most."""


class ChannelConditions(NamedTuple):
    """A rest bus of ``messages``, and errors as in ``settings``; ``seed`` draws both."""

    settings: BusSettings = BusSettings()
    messages: Sequence[PeriodicMessage] = ()
    seed: int = 1


UNDISTURBED = ChannelConditions()


def client_number(name: str) -> int:
    """Return the number of a client from its name in settings; raises ValueError."""
    if not (name.isascii() and name.isdecimal()):
        raise ValueError("is not the number of a client, as the broker prints it: 1, 2, ...")
    return int(name)


class Channel:
    """One bus and the clients on it, by their numbers, with the ``delays`` of its frames.

    ``bitrate_bit_s``, ``data_bitrate_bit_s``, ``is_fifo``  as in BusModel
    ``start_ns``                                            when the time of its bus begins [ns]

    ``errors``          what went wrong on the wire; None where nothing can
    ``departed``        frames of clients that have gone
    ``traffic_frames``  frames of the rest bus
    """

    def __init__(
        self,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None,
        conditions: ChannelConditions = UNDISTURBED,
        start_ns: int = 0,
        *,
        is_fifo: bool = False,
    ) -> None:
        self.members: dict[int, Connection] = {}
        self.delays = ArbitrationDelays()
        self.errors = errors_of(
            conditions.settings, conditions.seed, client_number, self._is_acknowledged
        )
        self._reports = None if self.errors is None else ErrorReports(self.errors, self.members)
        self._traffic = (
            RestBus(conditions.messages, conditions.seed) if conditions.messages else None
        )
        if self._traffic is not None:
            self._traffic.on_wire = self._on_wire
        self._model = BusModel(
            bitrate_bit_s,
            data_bitrate_bit_s,
            FRAMES_WAITING_MAX,
            self.delays.record,
            is_fifo=is_fifo,
            errors=self.errors,
            traffic=self._traffic,
        )
        self._is_paced = self.errors is not None or self._traffic is not None
        self._start_ns, self._pace_ns = (start_ns, start_ns) if self._is_paced else (0, NEVER_NS)
        self._of_traffic: list[Delivery] = []
        self.traffic_frames = 0
        self._buffers = TransmitBuffers(is_fifo=is_fifo)
        self._bitrate_bit_s = bitrate_bit_s
        self._senders: dict[tuple[int, bool], int] = {}
        self._quiet_ns = self._requested_offs = self._lost_in_bus_off = 0
        self.departed = DepartedClients(self._model.withdraw, self._forget)

    @property
    def next_event_ns(self) -> int:
        """When the next frame is complete on the wire, or a bus-off may be over [ns]."""
        next_ns = min(self._model.next_event_ns + self._start_ns, self._pace_ns)
        if not self.bus_offs:
            return next_ns
        looks_ns = [one.recovery.next_look_ns for one in self.members.values() if one.recovery]
        return min([next_ns, *looks_ns])

    def is_due(self, now_ns: int) -> bool:
        """Whether to advance it before clients submit: errors may have ended a frame early."""
        return self.errors is not None or self.next_event_ns <= now_ns

    @property
    def load(self) -> BusLoad:
        """Totals of the bus so far."""
        return self._model.load

    @property
    def bus_offs(self) -> int:
        """How often a node has gone into bus-off, by a request or by errors."""
        return self._requested_offs + (0 if self.errors is None else self.errors.bus_offs)

    @property
    def lost_in_bus_off(self) -> int:
        """Frames lost in bus-off: sent then, or still waiting for the wire."""
        return self._lost_in_bus_off + self._model.lost_in_bus_off

    def join(self, client: Connection) -> None:
        """Take a client."""
        self.members[client.number] = client
        if self.errors is not None:
            self.errors.join(client.number)

    def submit(self, client: Connection, now_ns: int) -> bool:
        """Submit a client's frames, as many as may wait; returns whether these were all.

        Raises ProtocolError for an invalid frame.
        """
        while (frame := client.take_frame()) is not None:
            if client.recovery is not None:
                self._lost_in_bus_off += 1
                continue
            if not self._buffers.take(client, frame):
                client.put_back(frame)
                return False
            self._model.submit(frame, client.number, now_ns - self._start_ns)
            key = (frame.can_id, frame.flags & EXTENDED != 0)
            if key in self._senders or len(self._senders) < WATCHED_IDS_MAX:
                self._senders[key] = client.number
        return True

    def go_off(self, request: BusOff, now_ns: int, time_ns: int) -> Connection | None:
        """Put a client into bus-off, or change the restart time of one that is.

        A frame on the wire is still completed. Returns the client if it was not in bus-off before;
        None also if no client has sent the identifier.

        ``time_ns``  now, by the wall clock [ns]
        """
        can_id, extended, restart_after_ns = request
        client = self.members.get(self._senders.get((can_id, extended), 0))
        if client is None:
            return None
        restart_ns = now_ns + restart_after_ns
        if client.recovery is not None:
            client.recovery.restart_ns = min(client.recovery.restart_ns, restart_ns)
            return None
        withdrawn = self._model.withdraw(client.number)
        for frame in withdrawn:
            self._buffers.free(client, frame)
        self._lost_in_bus_off += len(withdrawn)
        self._requested_offs += 1
        client.recovery = Recovery(restart_ns, self._bitrate_bit_s)
        client.queue(pack_frame(client.record, BUS_OFF_FRAME, time_ns))
        return client

    def come_back(self, now_ns: int, time_ns: int) -> list[Connection]:
        """Let clients whose bus-off is over take part again, as in ``go_off``; returns them."""
        if not self.bus_offs:
            return []
        if self._model.next_event_ns == NEVER_NS:
            self._quiet_ns = now_ns
        back = [
            client
            for client in self.members.values()
            if client.recovery is not None
            and client.recovery.is_over(now_ns, self._model.load, self._quiet_ns)
        ]
        for client in back:
            client.recovery = None
            if self._reports is not None:
                self._model.access.is_off_at(client.number, now_ns - self._start_ns)
                self._reports.forget(client.number)
            client.queue(pack_frame(client.record, RESTARTED_FRAME, time_ns))
        return back

    def advance(self, now_ns: int) -> list[Delivery]:
        """Return what is complete, and free the places of the clients' frames in their buffers.

        The sender of an error frame is the client that it is for.
        """
        bus_ns = now_ns - self._start_ns
        completed = self._model.advance(bus_ns)
        if completed:
            self._quiet_ns = completed[-1].end_ns + self._start_ns
        for delivery in completed:
            if self._reports is None or not self._reports.is_repeated(delivery):
                self._free_place(delivery.sender, delivery.frame)
        if not self._is_paced:
            return completed
        self._pace_ns = now_ns + PACE_NS
        return [
            Delivery(end_ns + self._start_ns, sender, frame)
            for end_ns, sender, frame in self._with_others(completed, bus_ns)
        ]

    def _free_place(self, sender: int, frame: Frame) -> None:
        """Count a frame of a client that is complete."""
        member = self.members.get(sender)
        if member is not None:
            self._buffers.free(member, frame)
        else:
            self.departed.on_sent(sender)

    def _with_others(self, completed: list[Delivery], bus_ns: int) -> list[Delivery]:
        """Return the completed frames with those of the traffic and error frames, in order."""
        # The model hands a frame of the traffic over when it starts.
        others = [one for one in self._of_traffic if one.end_ns <= bus_ns]
        del self._of_traffic[: len(others)]
        if self._reports is not None and self.errors is not None:
            self.errors.next_hit_ns(bus_ns)  # the noise keeps up with an idle bus
            for sender in self._reports.gone_off:
                # The model has withdrawn their frames.
                if sender in self.members:
                    self._buffers.empty(self.members[sender])
                else:
                    self.departed.forget(sender)
            self._reports.gone_off.clear()
            others += self._reports.take(bus_ns)
        return sorted([*completed, *others], key=lambda delivery: delivery.end_ns)

    def _forget(self, sender: int) -> None:
        """Forget a departed client without frames."""
        self._model.access.forget(sender)
        if self._reports is not None:
            self._reports.forget(sender)

    def queue(self, delivery: Delivery, time_ns: int) -> Connection | None:
        """Queue a frame, complete at wall-clock time ``time_ns``, for all that want it.

        Returns the client that is in bus-off from this error frame on, if it is one.
        """
        end_ns, sender, frame = delivery
        if frame.flags & ERROR:
            return self._queue_error(delivery, time_ns)
        packed: dict[Struct, bytes] = {}
        all_missed = self._model.missed
        for member in self.members.values():
            if not member.wants(frame, sender):
                continue
            if all_missed and (missed := (end_ns - self._start_ns, member.number)) in all_missed:
                all_missed.discard(missed)
                continue
            record = member.record
            if member.number == sender:
                own = frame._replace(flags=frame.flags | OWN)
                member.queue(pack_frame(record, own, time_ns))
                continue
            if record not in packed:
                packed[record] = pack_frame(record, frame, time_ns)
            member.queue(packed[record])
        return None

    def _queue_error(self, report: Delivery, time_ns: int) -> Connection | None:
        end_ns, number, frame = report
        member, state = self.members.get(number), state_of(frame)
        if member is None or member.recovery is not None:
            return None
        if state is not None or member.wants_error_frames:
            member.queue(pack_frame(member.record, frame, time_ns))
        if state is not ControllerState.BUS_OFF:
            return None
        until_ns = self._model.access.off_until_ns(number) + self._start_ns
        member.recovery = Recovery(end_ns, self._bitrate_bit_s, until_ns)
        return member

    def leave(self, client: Connection) -> None:
        """Remove a client; its frames are still sent."""
        if self.members.pop(client.number, None) is not None:
            self.departed.add(client.number, client.frames_waiting)

    def _is_acknowledged(self, sender: int) -> bool:
        """Whether another node is there that takes part."""
        return self._traffic is not None or any(
            member.recovery is None for number, member in self.members.items() if number != sender
        )

    def _on_wire(self, end_ns: int, sender: int, frame: Frame) -> None:
        self.traffic_frames += 1
        self._of_traffic.append(Delivery(end_ns, sender, frame))
