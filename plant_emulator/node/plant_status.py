"""PLANT_STATUS: its content, and when it is due.

It is due every cycle, and in between where SAFETY differs from the last report:

    at once        it changes from a state set by commands to HOLDING, FALLBACK or SAFE_STATE, or
                   further in this order: a fault to be reported within the fault tolerant time
    at intervals   any other change, INTERVAL_NS after the last PLANT_STATUS at the earliest, so
                   that a flapping network does not cause a flood of frames

The end of limiting since the last PLANT_STATUS is not reported early: it waits for the cycle, and
so do latencies, losses and refusals.
"""

from ...dbc.messages import PlantStatus, SafetyState, SecondSender, Sender, limits
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS
from ...runtime.node.periodic import PeriodicTimer
from ..network.network import Network

PERIOD_NS = 100_000_000
INTERVAL_NS = 20_000_000
"""Shortest time between two reports of a change, as of CONTROLLER_SAFETY [ns]."""
_NO_MORE_LIMITING = (SafetyState.LIMITING, SafetyState.NORMAL)
_BY_COMMANDS = (SafetyState.NORMAL, SafetyState.LIMITING)
_LATENCY_S_MAX = limits(PlantStatus)["downlink_latency_s"].maximum
_LOST_COUNTERS = int(limits(PlantStatus)["lost"].maximum) + 1
_REJECTED_COUNTERS = int(limits(PlantStatus)["rejected"].maximum) + 1


class PlantStatusReports:
    """Makes the frames, and keeps which SAFETY was reported last, and when.

    ``start_ns``     when the first cycle begins [ns]

    ``clamped``      latencies sent as the end of their signal's range
    ``settled``      the state for which ``on_state`` need not be called; None: for every state
    """

    def __init__(self, start_ns: int) -> None:
        self._timer = PeriodicTimer(start_ns, PERIOD_NS)
        self._reported: SafetyState | None = None
        self._reported_ns = 0
        self._change_ns = NEVER_NS
        self.deadline_ns = start_ns
        self.settled: SafetyState | None = None
        self._sender = Sender(PlantStatus)
        self.clamped = 0

    def on_state(self, state: SafetyState, time_ns: int) -> None:
        """Process the present value of SAFETY."""
        reported = self._reported
        if state is reported and self._change_ns == NEVER_NS:
            return
        if reported is None:  # the first cycle is still to come
            return
        if state is reported or (reported, state) == _NO_MORE_LIMITING:
            self._change_ns = NEVER_NS
        elif state not in _BY_COMMANDS and state > reported:
            self._change_ns = min(self._change_ns, time_ns)
        elif self._change_ns == NEVER_NS:
            self._change_ns = max(time_ns, self._reported_ns + INTERVAL_NS)
        self.deadline_ns = min(self._timer.deadline_ns, self._change_ns)
        self.settled = reported if self._change_ns == NEVER_NS else None

    def on_report(self, state: SafetyState, time_ns: int, now_ns: int) -> None:
        """Record that PLANT_STATUS, due at ``time_ns``, reports a state."""
        if self._timer.deadline_ns <= time_ns:
            self._timer.advance(now_ns)
        self._reported, self._reported_ns = state, time_ns
        self._change_ns = NEVER_NS
        self.deadline_ns = self._timer.deadline_ns
        self.settled = state

    def frame(
        self, network: Network, refused: int, safety: SafetyState, second_sender: SecondSender
    ) -> Frame:
        """Return the frame; ``refused`` counts the frames refused on arrival so far."""
        status = PlantStatus(
            downlink_latency_s=self._latency_s(network.downlink.latest_latency_ns),
            uplink_latency_s=self._latency_s(network.uplink.latest_latency_ns),
            lost=network.lost % _LOST_COUNTERS,
            rejected=refused % _REJECTED_COUNTERS,
            safety=safety,
            second_sender=second_sender,
        )
        return self._sender.frame(status)

    def _latency_s(self, latency_ns: int) -> float:
        """Return a latency within its signal's range, which begins at 0 [s]."""
        latency_s = latency_ns * 1e-9
        if latency_s <= _LATENCY_S_MAX:
            return latency_s
        self.clamped += 1
        return _LATENCY_S_MAX
