"""What the CAN controllers of a channel's clients report: error frames, in SocketCAN's classes.

As with a driver, each client gets the changes of its own controller's state; one that asks for
error frames also gets each error on the bus, with its own counters.
"""

from collections.abc import Mapping

from ..bus_model.bus_errors import BusErrors, ErrorEvent
from ..bus_model.bus_model import Delivery
from ..bus_model.fault_confinement import ControllerState
from ..bus_model.socketcan_error_frames import error_frame, receiver_error_frame, state_frame
from .broker_connection import Connection


class ErrorReports:
    """Turns the errors of a bus into error frames for its ``members``, by their numbers.

    ``gone_off``  clients that have gone into bus-off; whoever empties their buffers takes them out
    """

    def __init__(self, errors: BusErrors, members: Mapping[int, Connection]) -> None:
        self._errors, self._members = errors, members
        self._states: dict[int, ControllerState] = {}  # of those that are not error active
        self._reports: list[Delivery] = []
        self._repeated: set[tuple[int, int]] = set()
        self.gone_off: list[int] = []
        errors.on_error = self._on_error
        errors.present = members

    def is_repeated(self, delivery: Delivery) -> bool:
        """Whether the frame is sent again although the others have received it."""
        return (delivery.end_ns, delivery.sender) in self._repeated

    def take(self, now_ns: int) -> list[Delivery]:
        """Return the error frames since the last call; the sender of each is whom it is for."""
        for number, state in tuple(self._states.items()):
            counters = self._errors.counters(number)
            if state is not ControllerState.BUS_OFF and counters.state is not state:
                self._note(number, counters.state)
                self._reports.append(Delivery(now_ns, number, state_frame(counters)))
        self._repeated.clear()
        reports, self._reports = self._reports, []
        return reports

    def forget(self, number: int) -> None:
        """Forget the state of a controller that begins again, or has left."""
        self._states.pop(number, None)

    def _note(self, number: int, state: ControllerState) -> bool:
        """Note a controller's state; returns whether it is another one than before."""
        known = self._states.pop(number, ControllerState.ERROR_ACTIVE)
        if state is not ControllerState.ERROR_ACTIVE:
            self._states[number] = state
        return state is not known

    def _on_error(self, event: ErrorEvent) -> None:
        if event.is_repeated:
            self._repeated.add((event.time_ns, event.sender))
        if event.state is ControllerState.BUS_OFF and event.sender > 0:  # not one of the traffic
            self.gone_off.append(event.sender)
        for number, member in self._members.items():
            if number == event.sender:
                self._note(number, event.state)
                frame = error_frame(event)
            else:
                counters = self._errors.counters(number)
                has_changed = self._note(number, counters.state)
                if not has_changed and not member.wants_error_frames:
                    continue
                frame = receiver_error_frame(event, counters, has_changed=has_changed)
            self._reports.append(Delivery(event.time_ns, number, frame))
