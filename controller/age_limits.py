"""[supervision]: when a message counts as stale, and which measurements are accepted.

Consequences of a stale message:

    LATERAL_ERROR     HOLDING (``controller.node.modes``): there is no measurement to steer by
    STEERING_STATUS   the delay is unknown (``controller.history.history``). Laws that do not need
                      it continue: LATERAL_ERROR still closes the loop, and to stop steering would
                      be worse
    VEHICLE_STATE     as above. Its curvature and yaw rate are out of date, and the steer that a
                      law derives from them fades out. Its speed changes slowly and stays in use
"""

from typing import Annotated, Literal, NamedTuple

from pydantic import Field, PositiveFloat, Tag

from ..dbc.messages import Freshness
from ..dbc.reception import SecondSenderAction
from ..runtime.node import NS_PER_MS
from ..runtime.settings import NUMBER_OR_WORD, OffWord, Settings

REPORTING_MS = 5.0
"""Part of the fault tolerant time for reporting on the bus: a late tick, and the wire."""
NO_LIMIT_NS = 1 << 62
"""The age limit of a message that never goes stale."""
_NEVER_SEEN, _FRESH, _STALE = Freshness.NEVER_SEEN, Freshness.FRESH, Freshness.STALE
_TIMEOUTS = ("measurement_timeout_ms", "steering_status_timeout_ms", "vehicle_state_timeout_ms")
"""Keys of [supervision], in the order of ``AgeLimits``."""

AgeMs = Annotated[float, Field(ge=1.0, le=10_000.0)]
AgeMsOrOff = Annotated[Annotated[AgeMs, Tag("number")] | OffWord, NUMBER_OR_WORD]


class SupervisionSettings(Settings):
    """What happens when messages stop, and when they are trusted again.

    ``fault_tolerant_time_ms``  after a message stops, the controller must react and report it on
                                the bus within this time (fault tolerant time interval, ISO 26262)
    ``measurement_timeout_ms``  a LATERAL_ERROR older than this is not used to steer: HOLDING. If
                                omitted: the fault tolerant time, less a period for the tick and
                                5 ms for the frame that reports it. A step in the network's latency
                                also is a gap in what arrives
    ``steering_status_timeout_ms``  without a STEERING_STATUS for longer, the delay counts as
                                unknown. If omitted: as above
    ``vehicle_state_timeout_ms``  without a VEHICLE_STATE for longer, its curvature and yaw rate
                                count as out of date and the delay as unknown. If omitted: as
                                above. "off": no limit, for a plant that sends it rarely
    ``hold_ms``                 how long the last command is held then
    ``ramp_rad_s``              how fast it is then ramped to zero; also how fast the difference
                                between the held command and the law's fades out on recovery
    ``recovery_frames``         good measurements in a row that end the hold or the ramp
    ``counter_lead_ms``         how much earlier than the time since the newest measurement explains
                                a newer one may come: the spread of the network's latency
    ``second_sender``           "report": a second sender is reported. "silent": while the report
                                lasts, no command is sent either, and the mode goes to HOLDING and
                                SAFE_STOP as if the vehicle stood
    ``stops_if_implausible``    which signals of the plant that contradict each other
                                (``controller.node.plausibility``) end the run in SAFE_STOP:
                                "opposed", those of which one has the wrong sign; true, all; false,
                                none. They are reported in any case
    """

    fault_tolerant_time_ms: Annotated[float, Field(ge=1.0, le=60_000.0)] = 150.0
    measurement_timeout_ms: AgeMs | None = None
    steering_status_timeout_ms: AgeMs | None = None
    vehicle_state_timeout_ms: AgeMsOrOff | None = None
    hold_ms: Annotated[float, Field(ge=0.0, le=10_000.0)] = 500.0
    ramp_rad_s: PositiveFloat = 0.2
    recovery_frames: Annotated[int, Field(ge=1, le=100)] = 5
    counter_lead_ms: Annotated[float, Field(ge=0.0, le=10_000.0)] = 300.0
    second_sender: SecondSenderAction = "report"
    stops_if_implausible: bool | Literal["opposed"] = "opposed"

    def refuse_late_reactions(self, period_ns: int) -> None:
        """Raise ValueError for a timeout that leaves too little time to react and to report."""
        period_ms = period_ns / NS_PER_MS
        for key in _TIMEOUTS:
            limit_ms = getattr(self, key)
            if isinstance(limit_ms, str):
                continue
            # A tick may come a whole period after the timeout.
            reaction_ms = period_ms + REPORTING_MS
            if (limit_ms or 1.0) + reaction_ms > self.fault_tolerant_time_ms:
                timeout = (
                    "a measurement timeout of 1 ms"
                    if limit_ms is None
                    else f"supervision.{key} = {limit_ms:g}"
                )
                raise ValueError(
                    f"{timeout}, a period of {period_ms:g} ms and {REPORTING_MS:g} ms to report it"
                    " are more than supervision.fault_tolerant_time_ms ="
                    f" {self.fault_tolerant_time_ms:g}"
                )


class AgeLimits(NamedTuple):
    """The age up to which a message counts as fresh [ns]."""

    lateral_error_ns: int
    steering_status_ns: int
    vehicle_state_ns: int


def freshness(arrival_ns: int | None, limit_ns: int, now_ns: int) -> Freshness:
    """Return whether the newest frame of a message is young enough."""
    if arrival_ns is None:
        return _NEVER_SEEN
    return _FRESH if now_ns - arrival_ns <= limit_ns else _STALE


def age_limits_of(table: SupervisionSettings, period_ns: int) -> AgeLimits:
    """Return the age limit of each message; omitted ones follow from the fault tolerant time."""
    reaction_ms = period_ns / NS_PER_MS + REPORTING_MS

    def limit_ns(limit_ms: float | str | None) -> int:
        if isinstance(limit_ms, str):
            return NO_LIMIT_NS
        if limit_ms is None:
            limit_ms = table.fault_tolerant_time_ms - reaction_ms
        return round(limit_ms * NS_PER_MS)

    return AgeLimits(*(limit_ns(getattr(table, key)) for key in _TIMEOUTS))


def resync_ns_of(table: SupervisionSettings, period_ns: int) -> int:
    """Return the silence of a message after which a restart of its sender is accepted [ns].

    It is longer than any age limit plus the tick that acts on it. A stream of measurements that
    does not continue the previous one is therefore used only after a hold and the run that ends it.
    """
    limits = (limit_ns for limit_ns in age_limits_of(table, period_ns) if limit_ns != NO_LIMIT_NS)
    return max(limits) + period_ns + 1
