"""One channel of the broker: a bus with its own time, and the clients on it.

Rest bus and errors are those of the bus model, as in virtual time; their time begins with the
channel. Such a channel is advanced every PACE_NS at least, so that frames of the traffic reach the
clients up to that much late, with their right times.

Each client has the error counters of a CAN controller, and gets the error frame that SocketCAN
would deliver (linux/can/error.h) when its state changes. In bus-off it neither sends nor receives.
"""

from collections.abc import Sequence
from struct import Struct
from typing import NamedTuple

from ..bus_model.bus_errors import ErrorEvent
from ..bus_model.bus_model import BusLoad, BusModel, Delivery
from ..bus_model.fault_confinement import ControllerState
from ..bus_model.rest_bus import PeriodicMessage, RestBus
from ..bus_model.settings import BusSettings, errors_of
from ..bus_model.socketcan_error_frames import RESTARTED_FRAME, error_frame, state_frame, state_of
from ..frame import ERROR, Frame
from ..node import NEVER_NS, NS_PER_MS
from .broker_connection import Connection
from .protocol import OWN, pack_frame
from .transmit_buffers import FRAMES_WAITING_MAX

PACE_NS = NS_PER_MS
"""How long a channel with traffic or errors is left alone at most."""
LEFT_FRAMES_MAX = 1024
"""Frames of departed clients that may wait on one channel, so that no client fills the bus by
joining and leaving. Beyond that, a client that leaves loses its frames."""


class ChannelConditions(NamedTuple):
    """A rest bus of ``messages``, and errors as in ``settings``; ``seed`` draws both."""

    settings: BusSettings = BusSettings()
    messages: Sequence[PeriodicMessage] = ()
    seed: int = 1


UNDISTURBED = ChannelConditions()


class Channel:
    """One bus and the clients on it, by their numbers.

    ``bitrate_bit_s``, ``data_bitrate_bit_s``  as in BusModel
    ``start_ns``                               when the time of its bus begins [ns]

    ``errors``          what went wrong on the wire; None where nothing can
    ``traffic_frames``  frames of the rest bus
    ``discarded``       frames of departed clients that were never sent
    """

    def __init__(
        self,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None,
        conditions: ChannelConditions = UNDISTURBED,
        start_ns: int = 0,
    ) -> None:
        self.members: dict[int, Connection] = {}
        self.errors = errors_of(conditions.settings, conditions.seed)
        if self.errors is not None:
            self.errors.on_error = self._on_error
        traffic = RestBus(conditions.messages, conditions.seed) if conditions.messages else None
        if traffic is not None:
            traffic.on_wire = self._on_wire
        self._model = BusModel(
            bitrate_bit_s,
            data_bitrate_bit_s,
            FRAMES_WAITING_MAX,
            errors=self.errors,
            traffic=traffic,
        )
        self._is_paced = self.errors is not None or traffic is not None
        self._start_ns, self._pace_ns = (start_ns, start_ns) if self._is_paced else (0, NEVER_NS)
        self._of_traffic: list[Delivery] = []
        self._bus_offs: list[ErrorEvent] = []
        self._off_until_ns: dict[int, int] = {}
        self._states: dict[int, ControllerState] = {}  # of those that are not error active
        self._departed: dict[int, int] = {}  # frames that wait, by client
        self.traffic_frames = self.discarded = 0

    @property
    def next_event_ns(self) -> int:
        """When the next frame is complete on the wire, or a bus-off is over [ns]."""
        next_ns = min([self._model.next_event_ns, *self._off_until_ns.values()])
        return min(next_ns + self._start_ns, self._pace_ns)

    def is_due(self, now_ns: int) -> bool:
        """Whether to advance it before clients submit: errors may have ended a frame early."""
        return self.errors is not None or self.next_event_ns <= now_ns

    @property
    def load(self) -> BusLoad:
        """Totals of the bus so far."""
        return self._model.load

    @property
    def lost_in_bus_off(self) -> int:
        """Frames lost in bus-off: sent then, or still waiting for the wire."""
        return self._model.lost_in_bus_off

    def join(self, client: Connection) -> None:
        """Admit a client."""
        self.members[client.number] = client
        if self.errors is not None:
            self.errors.join(client.number)

    def submit(self, client: Connection, now_ns: int) -> bool:
        """Submit a client's frames, as many as may wait; returns whether these were all.

        Raises ProtocolError for an invalid frame.
        """
        bus_ns = now_ns - self._start_ns
        while (frame := client.next_frame()) is not None:
            if self._model.is_off(client.number, bus_ns):
                self._model.lost_in_bus_off += 1
                continue
            if not client.buffers.has_room(frame):
                client.put_back(frame)
                return False
            client.tell(client.buffers.add(frame, can_tell=not client.is_behind))
            self._model.submit(frame, client.number, bus_ns)
        return True

    def advance(self, now_ns: int) -> list[Delivery]:
        """Return what is complete, and free the places of the clients' frames in their buffers.

        The sender of an error frame is the client that it is for.
        """
        bus_ns = now_ns - self._start_ns
        completed = self._model.advance(bus_ns)
        for _, sender, frame in completed:
            self._free_place(sender, frame)
        if not self._is_paced:
            return completed
        self._pace_ns = now_ns + PACE_NS
        # The model hands a frame of the traffic over when it starts.
        of_traffic = [one for one in self._of_traffic if one.end_ns <= bus_ns]
        del self._of_traffic[: len(of_traffic)]
        reports = self._error_frames(bus_ns)
        return [
            Delivery(end_ns + self._start_ns, sender, frame)
            for end_ns, sender, frame in sorted(
                [*completed, *of_traffic, *reports], key=lambda delivery: delivery.end_ns
            )
        ]

    def queue(self, delivery: Delivery, time_ns: int) -> None:
        """Queue a frame, complete at wall-clock time ``time_ns``, for all that want it."""
        _, sender, frame = delivery
        if frame.flags & ERROR:
            if (concerned := self.members.get(sender)) is not None:
                concerned.is_off = state_of(frame) is ControllerState.BUS_OFF
                concerned.queue(pack_frame(concerned.record, frame, time_ns))
            return
        packed: dict[Struct, bytes] = {}
        for member in self.members.values():
            if not member.wants(frame, sender):
                continue
            record = member.record
            if member.number == sender:
                own = frame._replace(flags=frame.flags | OWN)
                member.queue(pack_frame(record, own, time_ns))
                continue
            if record not in packed:
                packed[record] = pack_frame(record, frame, time_ns)
            member.queue(packed[record])

    def leave(self, client: Connection) -> None:
        """Remove a client; its frames are still sent, up to LEFT_FRAMES_MAX of all departed."""
        number = client.number
        if self.members.pop(number, None) is None:
            return
        self._states.pop(number, None)
        self._off_until_ns.pop(number, None)
        waiting = client.buffers.frames_waiting
        if waiting + sum(self._departed.values()) > LEFT_FRAMES_MAX:
            withdrawn = len(self._model.withdraw(number))
            self.discarded += withdrawn
            waiting -= withdrawn
        self._departed[number] = waiting
        self._forget_if_sent(number)

    def _free_place(self, sender: int, frame: Frame) -> None:
        """Count a frame of a client that is complete."""
        if (member := self.members.get(sender)) is not None:
            member.tell(member.buffers.remove(frame))
        else:
            self._departed[sender] -= 1
            self._forget_if_sent(sender)

    def _forget_if_sent(self, number: int) -> None:
        if not self._departed[number]:
            del self._departed[number]
            self._model.access.forget(number)

    def _error_frames(self, bus_ns: int) -> list[Delivery]:
        """Return what the controllers of the clients report: changes of their states."""
        if self.errors is None:
            return []
        self.errors.next_hit_ns(bus_ns)  # the noise keeps up with an idle bus
        reports = []
        for event in self._bus_offs:
            number = event.sender
            if (member := self.members.get(number)) is not None:
                member.tell(*member.buffers.clear())  # the model has withdrawn its frames
                self._off_until_ns[number] = event.time_ns + self._model.access.bus_off_ns
                self._states.pop(number, None)
                reports.append(Delivery(event.time_ns, number, error_frame(event)))
            else:
                self._departed[number] = 0
                self._forget_if_sent(number)
        self._bus_offs.clear()
        for number, until_ns in tuple(self._off_until_ns.items()):
            if until_ns <= bus_ns:
                del self._off_until_ns[number]
                self._model.is_off(number, bus_ns)
                reports.append(Delivery(until_ns, number, RESTARTED_FRAME))
        for number in self.members.keys() - self._off_until_ns.keys():
            counters = self.errors.counters(number)
            if counters.state is not self._states.get(number, ControllerState.ERROR_ACTIVE):
                self._states[number] = counters.state
                reports.append(Delivery(bus_ns, number, state_frame(counters)))
        return reports

    def _on_error(self, event: ErrorEvent) -> None:
        if event.state is ControllerState.BUS_OFF and event.sender > 0:  # not one of the traffic
            self._bus_offs.append(event)

    def _on_wire(self, end_ns: int, sender: int, frame: Frame) -> None:
        self.traffic_frames += 1
        self._of_traffic.append(Delivery(end_ns, sender, frame))
