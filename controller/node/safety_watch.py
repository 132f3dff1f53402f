"""What CONTROLLER_SAFETY must report in time, found anew only where something may have changed."""

from typing import Any

from ...dbc.messages import ControllerFault, Freshness, MotionRequest, SecondSender
from ...runtime.record import new_record
from ..interface.validity import ValiditySettings, request_of, validity_of
from .received import SUPERVISED, Received
from .safety import SafetyFacts

_ALL_FRESH = (Freshness.FRESH,) * len(SUPERVISED)
_NO_OTHER = SecondSender.NONE


class SafetyWatch:
    """Keeps the facts.

    ``table``     what the settings were designed for
    ``received``  what has come
    ``start_ns``  when the controller starts [ns]

    ``facts``     as found last
    ``validity``  whether speed and delay are within the table, as judged last
    """

    def __init__(self, table: ValiditySettings | None, received: Received, start_ns: int) -> None:
        self._table, self._received = table, received
        self.validity = validity_of(table, None, None)
        self.facts = SafetyFacts(
            0,
            *received.freshness(start_ns),
            ControllerFault.NONE,
            _NO_OTHER,
            self.validity,
            MotionRequest.NONE,
        )
        self._seen: tuple[Any, ...] = ()
        """What the facts were found from, besides times."""
        self._fresh_until_ns = -1
        """End of the facts' validity, if that has not changed [ns]."""

    def judge_validity(self, delay_s: float | None) -> None:
        """Compare the speed and a delay, None if unknown, with the table."""
        received = self._received
        speed_m_s = None if received.states.arrival_ns is None else received.vehicle.speed_m_s
        self.validity = validity_of(self._table, speed_m_s, delay_s)

    def facts_at(self, fault: ControllerFault, must_stop: bool, now_ns: int) -> SafetyFacts:
        """Return the facts.

        ``fault``      what the controller has detected in itself
        ``must_stop``  whether the vehicle must, whatever the validity
        """
        received, validity = self._received, self.validity
        seen = (received.reception.refused, received.unauthenticated, fault, validity, must_stop)
        if now_ns <= self._fresh_until_ns and seen == self._seen:
            return self.facts
        self._seen = seen
        request = request_of(validity, must_stop=must_stop)
        freshness = received.freshness(now_ns)
        second_sender = received.reception.second_sender(now_ns)
        found = (received.refused, *freshness, fault, second_sender, validity, request)
        if found != self.facts:
            self.facts = new_record(SafetyFacts, found)
        # A stale message may return at any time, and a second sender is forgotten after a while.
        is_calm = freshness == _ALL_FRESH and second_sender is _NO_OTHER
        self._fresh_until_ns = received.fresh_until_ns() if is_calm else -1
        return self.facts
