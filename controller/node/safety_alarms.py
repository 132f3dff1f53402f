"""CONTROLLER_SAFETY: what it reports, and what makes it leave at once.

    every STATUS_PERIOD_NS   in any case (``controller.node.status_frames``)
    at the next tick         a message has become stale, a fault is detected, or more is asked of
                             the vehicle's drive. This must be on the bus within the fault tolerant
                             time, of which the age limit leaves one period
    at intervals             any other change since the last report, such as a refused frame or a
                             message that is back: at the first tick INTERVAL_NS after the last
                             report. Without this limit a flood of bad frames would cause a flood
                             of reports

A message that stops and returns repeatedly is reported as stale again only after it was reported as
back, so that the number of reports is bounded. Lost frames alone wait for the next cycle, because a
network loses some all the time.
"""

from typing import Any

from ...dbc.messages import (
    ControllerFault,
    ControllerSafety,
    Freshness,
    Mode,
    SecondSender,
    Sender,
    SteeringStatusCode,
    Validity,
    limits,
)
from ...runtime.frame import Frame
from ..limits.designed_ranges import DesignedRanges, request_of, validity_of
from .modes import Supervisor
from .newest_messages import SUPERVISED, Received

INTERVAL_NS = 20_000_000
"""50 frames a second are 1.4 % of a 500 kbit/s bus, and 20 ms is a seventh of the 150 ms within
which a refusal must be reported."""
_AGES = ("lateral_error", "steering_status", "vehicle_state")
LOST_COUNTERS = int(limits(ControllerSafety)["rejected"].maximum) + 1
"""Values of the counters of frames, which wrap."""
_ALL_FRESH = (Freshness.FRESH,) * len(SUPERVISED)
_NO_OTHER, _STALE = SecondSender.NONE, Freshness.STALE
_NOT_STEERED_FROM = SteeringStatusCode.FALLBACK
"""From this code on the steering follows no commands; while the driver steers, it follows him."""
_DRIVER_STEERS = SteeringStatusCode.DRIVER_STEERS


def is_worse(x: ControllerSafety, reported: ControllerSafety) -> bool:
    """Whether a report must leave at once.

    A message has become stale, a fault was detected, or more is asked of the vehicle's drive.
    """
    return (
        x.fault is not reported.fault
        or x.motion_request > reported.motion_request
        or (x.lateral_error_freshness is _STALE and reported.lateral_error_freshness is not _STALE)
        or (
            x.steering_status_freshness is _STALE
            and reported.steering_status_freshness is not _STALE
        )
        or (x.vehicle_state_freshness is _STALE and reported.vehicle_state_freshness is not _STALE)
    )


def is_report_due(x: ControllerSafety, reported: ControllerSafety, since_ns: int) -> bool:
    """Whether to report facts before the next cycle, ``since_ns`` after the last report."""
    return x != reported and (since_ns >= INTERVAL_NS or is_worse(x, reported))


def facts_of(
    refused: int,
    lateral_error: Freshness,
    steering_status: Freshness,
    vehicle_state: Freshness,
    fault: ControllerFault,
    second_sender: SecondSender,
    validity: Validity,
    mode: Mode,
    goes_forward: bool,
    steering: SteeringStatusCode,
) -> ControllerSafety:
    """Return the message without the frames lost, which alone are no reason to report.

    The vehicle must stop where it is not steered, or soon will not be.
    """
    is_stopping = mode is Mode.SAFE_STOP or not goes_forward
    is_unsteered = steering >= _NOT_STEERED_FROM and steering is not _DRIVER_STEERS
    request = request_of(validity, is_stopping or is_unsteered)
    return ControllerSafety(
        rejected=refused % LOST_COUNTERS,
        lost=0,
        lateral_error_freshness=lateral_error,
        steering_status_freshness=steering_status,
        vehicle_state_freshness=vehicle_state,
        fault=fault,
        second_sender=second_sender,
        validity=validity,
        motion_request=request,
    )


class SafetyReport:
    """Finds the facts again where something may have changed, and makes the frames.

    ``facts``       as found last
    ``validity``    whether speed and delay are within the ranges, as judged last
    ``went_stale``  how often each message has become stale
    """

    def __init__(
        self, ranges: DesignedRanges, received: Received, modes: Supervisor, start_ns: int
    ) -> None:
        self._ranges, self._received, self._modes = ranges, received, modes
        self.validity = validity_of(self._ranges, None, None, True)
        state = modes.mode, modes.goes_forward, received.status.status
        freshness, no_fault = received.freshness(start_ns), ControllerFault.NONE
        self._inputs = (0, *freshness, no_fault, _NO_OTHER, self.validity, *state)
        """Of ``facts_of``; compared in a fifteenth of the time that making the message takes."""
        self.facts = facts_of(*self._inputs)
        self._found_from: tuple[Any, ...] = ()
        """What the facts were found from, besides times."""
        self._fresh_until_ns = -1
        """Until when the facts hold, if that has not changed [ns]."""
        self._before: ControllerSafety | None = None
        self.went_stale = dict.fromkeys(_AGES, 0)
        self._reported: ControllerSafety | None = None
        self._reported_ns = 0
        self._sender = Sender(ControllerSafety)

    def judge_validity(self, delay_s: float | None, *, fits_model: bool) -> None:
        """Compare the speed and a delay, None if unknown, with the ranges.

        ``fits_model``  whether the vehicle is in the settings' box, as far as is known
        """
        received = self._received
        speed_m_s = None if received.states.arrival_ns is None else received.vehicle.speed_m_s
        self.validity = validity_of(self._ranges, speed_m_s, delay_s, fits_model)

    def on_tick(self, fault: ControllerFault, now_ns: int) -> bool:
        """Find the facts of a tick; returns whether to report them before the next cycle."""
        facts = self._facts_at(fault, now_ns)
        before, reported = self._before, self._reported
        if facts is before and facts is reported:
            return False
        if before is not None and facts != before:
            for name in _AGES:
                field = f"{name}_freshness"
                if getattr(facts, field) is _STALE and getattr(before, field) is not _STALE:
                    self.went_stale[name] += 1
        self._before = facts
        return reported is not None and is_report_due(facts, reported, now_ns - self._reported_ns)

    def frame(self, fault: ControllerFault, now_ns: int) -> Frame:
        """Return the frame that reports the present facts and the frames lost so far.

        ``fault``  what the controller has detected in itself
        """
        facts, lost = self._facts_at(fault, now_ns), self._received.reception.lost
        self._reported, self._reported_ns = facts, now_ns
        return self._sender.frame(facts._replace(lost=lost % LOST_COUNTERS))

    def _facts_at(self, fault: ControllerFault, now_ns: int) -> ControllerSafety:
        received, modes, validity = self._received, self._modes, self.validity
        state = modes.mode, modes.goes_forward, received.status.status
        found_from = received.reception.refused, received.unauthenticated, fault, validity, *state
        if now_ns <= self._fresh_until_ns and found_from == self._found_from:
            return self.facts
        self._found_from = found_from
        freshness = received.freshness(now_ns)
        second_sender = received.reception.second_sender(now_ns)
        inputs = received.refused, *freshness, fault, second_sender, validity, *state
        if inputs != self._inputs:
            self._inputs, self.facts = inputs, facts_of(*inputs)
        # A stale message may return at any time, and a second sender is forgotten after a while.
        is_calm = freshness == _ALL_FRESH and second_sender is _NO_OTHER
        self._fresh_until_ns = received.fresh_until_ns() if is_calm else -1
        return self.facts
