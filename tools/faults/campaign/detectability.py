"""Which fault is detectable, and by which mechanism: decided before any run, from the fault alone.

Each mechanism observes one thing, and can detect nothing else:

    E2E               CRC, length, identifier and counter of a frame that arrives
    RANGE             a raw value outside its signal's range or value table
    FRESHNESS         no acceptable frame of a message to a node within the message's age limit
    LIMITER           a command beyond the safety limiter's bounds
    SELF_SUPERVISION  own ticks missed

A fault that none of them observes is not detectable. A receiver with a single source cannot
distinguish a plausible value with a valid CRC and counter from a true one. A frame that is late by
less than the age limit cannot be distinguished from what the network is allowed to do.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

from ....controller.age_limits import NO_LIMIT_NS
from ....controller.node.node import RECEIVED as CONTROLLER_RECEIVES
from ....controller.node.status_frames import STATUS_PERIOD_NS
from ....controller.settings import ControllerSettings
from ....dbc.codec.counter_rule import CounterRule
from ....dbc.codec.protection import COUNTERS
from ....dbc.messages import MESSAGE_TYPES
from ....plant_emulator.faults.effects import BURST_CHANCE, REORDER_CHANCE
from ....plant_emulator.faults.messages_on_bus import bits_of
from ....plant_emulator.faults.settings import (
    ALL,
    MESSAGES_OF,
    FaultDirection,
    FaultKind,
    FaultSettings,
)
from ....plant_emulator.node.node import RECEIVED as PLANT_RECEIVES
from ....plant_emulator.sensors.sampling import samples_per_vehicle_state
from ....plant_emulator.settings import PlantSettings
from ....plant_emulator.steering.settings import design_guard
from ....runtime.node import NS_PER_S
from .campaign_file import NodeFaultKind
from .node_faults import NodeFault

LAW_RAD_MAX = 0.2
"""The largest command that a law is assumed to want, if the limiter allows that much."""
NO_EFFECT_CHANCE_MAX = 1e-4
"""A fault that changes nothing with a larger probability than this may do so."""
WATCHING_PERIOD_S = STATUS_PERIOD_NS / NS_PER_S
"""Cycle of the messages for monitoring."""
COMMANDS = frozenset({"STEERING_COMMAND", "STEERING_PLAN"})  # a law sends one of them
CONTROLS = COMMANDS | {"LATERAL_ERROR", ALL}
"""Messages without which a node has to leave control."""
STREAMS = CONTROLS | {"STEERING_STATUS", "VEHICLE_STATE"}
"""Messages whose age is watched."""
UNRECEIVED = frozenset(
    name
    for name, message_type in MESSAGE_TYPES.items()
    if any(message_type in faulty for faulty in MESSAGES_OF.values())
    and message_type not in (*CONTROLLER_RECEIVES, *PLANT_RECEIVES)
)
"""Messages for monitoring that faults act on: no node receives them."""


class Mechanism(StrEnum):
    """What can detect a fault."""

    E2E = "E2E"
    RANGE = "range"
    FRESHNESS = "freshness"
    LIMITER = "limiter"
    SELF_SUPERVISION = "self-supervision"


_COUNTS: Mapping[Mechanism, str] = MappingProxyType(
    {
        Mechanism.E2E: "bad_crc masqueraded wrong_length wrong_format repeated out_of_order "
        "too_far own_identifier lost",
        Mechanism.RANGE: "out_of_range not_available",
        Mechanism.FRESHNESS: "silence stale",
        Mechanism.LIMITER: "intervention",
        Mechanism.SELF_SUPERVISION: "skipped_ticks law_failures failure safe_state",
    }
)
MECHANISM_OF: Mapping[str, Mechanism] = MappingProxyType(
    {name: mechanism for mechanism, names in _COUNTS.items() for name in names.split()}
)
"""Which mechanism a count in a node's report belongs to."""


def causes_of(mechanisms: Sequence[Mechanism]) -> frozenset[str]:
    """Return the counts that belong to mechanisms; a program's sum of refused frames to two."""
    own = {cause for cause, mechanism in MECHANISM_OF.items() if mechanism in mechanisms}
    refusing = {Mechanism.E2E, Mechanism.RANGE} & set(mechanisms)
    return frozenset(own | ({"rejected"} if refusing else set()))


class Sight(NamedTuple):
    """What the mechanisms of a pair can detect, by its settings.

    ``age_limit_s``     the longest of both nodes' age limits: what lasts longer is silence for both
    ``limiter_rad``     largest command that the safety limiter lets through, at this speed
    ``control_period_s``, ``sensor_period_s``  of the commands and of the measurements
    ``commands``, ``measurements``  which counters are believed
    ``jitters_down``    whether a silence of the commands may be shorter at the actuator than on the
                        bus
    """

    age_limit_s: float
    limiter_rad: float
    control_period_s: float
    sensor_period_s: float
    commands: CounterRule
    measurements: CounterRule
    jitters_down: bool = False


class Expectation(NamedTuple):
    """What is expected of a fault.

    ``mechanisms``   that can see it; none: it is not detectable
    ``safe_state``   whether the receiver has to leave control, for lack of anything to act on
    ``why``          in a line
    ``is_followed``  whether false frames may be accepted after it has been detected, as no receiver
                     can distinguish them from true ones
    ``may_be_idle``  whether it may have no effect: by chance, or because its magnitude is none
    """

    mechanisms: tuple[Mechanism, ...]
    safe_state: bool
    why: str
    is_followed: bool = False
    may_be_idle: bool = False


def sight_of(plant: PlantSettings, controller: ControllerSettings) -> Sight:
    """Return what the mechanisms of a pair can detect."""
    guard = design_guard(plant.safety, plant.vehicle, plant.actuator)
    ages = (age for age in controller.age_limits if age != NO_LIMIT_NS)
    return Sight(
        max(guard.silence_ns, *ages) / NS_PER_S,
        guard.limiter.table.least_reach_rad,
        controller.period_ns / NS_PER_S,
        plant.sensor_period_ns / NS_PER_S,
        plant.counters,
        controller.counters,
        plant.latency.downlink.spread_s > 0.0,
    )


_E2E, _RANGE = (Mechanism.E2E,), (Mechanism.RANGE,)
_FRESHNESS = (Mechanism.FRESHNESS,)
_EITHER = (Mechanism.E2E, Mechanism.FRESHNESS)
_PLAUSIBLE = "a plausible value, valid CRC and counter: one source, nothing to compare it with"


def expect_fault(fault: FaultSettings, sight: Sight) -> Expectation:
    """Return what is expected of a fault of the stage at the plant's edge."""
    expected = _expect(fault, sight)
    return expected._replace(may_be_idle=no_effect_chance(fault, sight) > NO_EFFECT_CHANCE_MAX)


def _expect(fault: FaultSettings, sight: Sight) -> Expectation:
    if is_unreceived(fault):
        return Expectation((), False, "no node receives this message: nothing may change")
    is_stream, is_control = fault.message in STREAMS, fault.message in CONTROLS
    magnitude, period_s = fault.magnitude, period_s_of(fault, sight)
    late_s = min(magnitude, fault.duration_s)
    match fault.kind:
        case FaultKind.DROP if magnitude >= 1.0:
            return _silence(fault, sight, is_stream, is_control)
        case FaultKind.BURST_LOSS if period_s * magnitude > sight.age_limit_s and is_stream:
            return Expectation(_EITHER, is_control, "a burst longer than the age limit")
        case FaultKind.DROP | FaultKind.BURST_LOSS:
            return Expectation(_E2E, False, "the counter jumps")
        case FaultKind.DUPLICATE:
            return Expectation(_E2E, False, "a counter comes twice")
        case FaultKind.REORDER:
            return Expectation(_E2E, False, "the counter jumps, then goes back")
        case FaultKind.DELAY_SPIKE if is_stream and late_s > sight.age_limit_s:
            why = "nothing arrives for longer than the age limit"
            return Expectation(_FRESHNESS, is_control, why)
        case FaultKind.DELAY_SPIKE:
            return Expectation((), False, "late by less than the age limit: the network may")
        case FaultKind.FREEZE:
            return Expectation(_E2E, is_control, "the same counter again and again")
        case FaultKind.BIT_FLIPS:
            every_frame = is_control and (1.0 - magnitude) ** bits_of(fault) < 1e-3
            return Expectation(_E2E, every_frame, "the CRC is not that of the content")
        case FaultKind.WRONG_LENGTH:
            return Expectation(_E2E, is_control, "not the length of the message")
        case FaultKind.WRONG_IDENTIFIER:
            return _moved(fault, is_control)
        case FaultKind.SPOOF:
            why = "the true sender's counter then comes twice, and neither of the two is followed"
            return Expectation(_E2E, False, why, is_followed=True)
        case FaultKind.REPLAY:
            # Counters wrap around: old frames look like those that follow lost ones, or are
            # rejected until they reach the newest one that was accepted.
            behind = round(magnitude / period_s) % COUNTERS
            period_ns = round(period_s * NS_PER_S)
            rule = sight.commands if fault.message in COMMANDS else sight.measurements
            step_max = 1 + (rule.lead_ns + period_ns) // period_ns
            refused_s = behind * period_s if COUNTERS - behind > step_max else 0.0
            is_long = min(fault.duration_s, refused_s) > sight.age_limit_s + period_s
            why = "the counter goes back; what goes on so is a new start, after a hold"
            # It continues when the bus was silent for the age limit: jitter may hide the silence.
            is_hidden = sight.jitters_down and fault.message in COMMANDS
            is_left = is_control and is_long and not is_hidden
            return Expectation(_E2E, is_left, why, is_followed=True)
        case FaultKind.OUT_OF_RANGE:
            silent = is_control and magnitude >= 1.0
            return Expectation(_RANGE, silent, "a raw value outside the range")
        case FaultKind.OFFSET if _beats_limiter(fault, sight, magnitude):
            why = "beyond what the limiter lets through"
            return Expectation((Mechanism.LIMITER,), False, why, is_followed=True)
        case FaultKind.NOISE if _beats_limiter(fault, sight, 0.25 * magnitude):
            why = "often beyond what the limiter lets through"
            return Expectation((Mechanism.LIMITER,), False, why, is_followed=True)
        case _:
            return Expectation((), False, _PLAUSIBLE)


def is_unreceived(fault: FaultSettings) -> bool:
    """Whether no node receives the frames the fault acts on, or those that it makes of them."""
    return fault.message in UNRECEIVED and fault.kind is not FaultKind.WRONG_IDENTIFIER


def expect_node_fault(fault: NodeFault, sight: Sight) -> Expectation:
    """Return what is expected of a fault of a node."""
    if fault.kind is NodeFaultKind.CLOCK_JUMP:
        supervision = (Mechanism.SELF_SUPERVISION,)
        if fault.magnitude > sight.age_limit_s:
            both = (Mechanism.SELF_SUPERVISION, Mechanism.FRESHNESS)
            return Expectation(both, True, "ticks missed, and its measurement looks old")
        if fault.magnitude > 2.0 * sight.control_period_s:
            return Expectation(supervision, False, "ticks missed")
        return Expectation((), False, "less than two periods")
    if fault.duration_s <= sight.age_limit_s and fault.kind is not NodeFaultKind.KILLED:
        return Expectation((), False, "shorter than the age limit")
    return Expectation(_FRESHNESS, True, "its peer receives nothing")


def period_s_of(fault: FaultSettings, sight: Sight) -> float:
    """Return the time from one frame that a fault acts on to the next [s]."""
    if fault.message in UNRECEIVED:
        return WATCHING_PERIOD_S
    if fault.direction is FaultDirection.DOWNLINK:
        return sight.control_period_s
    if fault.message == "VEHICLE_STATE":
        samples = samples_per_vehicle_state(round(sight.sensor_period_s * NS_PER_S))
        return samples * sight.sensor_period_s
    return sight.sensor_period_s


def no_effect_chance(fault: FaultSettings, sight: Sight) -> float:
    """Return the probability that a fault changes no frame at all, by what it draws.

    1 for a value that is none (an offset of 0), and for the speed, which is constant anyway.
    """
    magnitude = fault.magnitude
    frames = int(fault.duration_s / period_s_of(fault, sight))
    match fault.kind:
        case FaultKind.BURST_LOSS:
            spared = 1.0 - BURST_CHANCE
        case FaultKind.REORDER:
            spared = 1.0 - REORDER_CHANCE
        case FaultKind.BIT_FLIPS:
            spared = (1.0 - magnitude) ** bits_of(fault)
        case FaultKind.WRONG_LENGTH:
            spared = float(magnitude >= bits_of(fault) / 8)
        case FaultKind.SCALE:
            spared = float(magnitude == 1.0)
        case FaultKind.OFFSET | FaultKind.DRIFT | FaultKind.NOISE | FaultKind.DELAY_SPIKE:
            spared = float(magnitude == 0.0)
        case FaultKind.STUCK:
            spared = float(fault.signal == "speed_m_s")
        case FaultKind.SPOOF | FaultKind.REPLAY:
            spared = 0.0
        case _:  # the magnitude is a share of the frames
            spared = 1.0 - min(magnitude, 1.0)
    return float(max(spared, 0.0) ** frames) if frames else 1.0


def _silence(fault: FaultSettings, sight: Sight, is_stream: bool, is_control: bool) -> Expectation:
    if not is_stream:
        return Expectation((), False, "this message has no age limit")
    if fault.duration_s <= sight.age_limit_s:
        return Expectation((), False, "shorter than the age limit, and then a counter that jumps")
    return Expectation(_FRESHNESS, is_control, "nothing arrives")


def _moved(fault: FaultSettings, is_control: bool) -> Expectation:
    """A frame under another identifier: its receiver rejects it by the Data ID, if there is one."""
    if fault.message in COMMANDS:
        return Expectation(_FRESHNESS, True, "the plant does not receive that identifier")
    return Expectation(_E2E, is_control, "the CRC is that of another identifier")


def _beats_limiter(fault: FaultSettings, sight: Sight, value_rad: float) -> bool:
    """Whether a command that is wrong by so much exceeds the bound, whatever the law wants."""
    wanted_rad = min(LAW_RAD_MAX, sight.limiter_rad)
    return fault.message in COMMANDS and abs(value_rad) >= sight.limiter_rad + wanted_rad
