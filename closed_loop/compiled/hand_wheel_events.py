"""Events of a hand wheel in a compiled run, and their times; the network alone decides these.

At one instant, with what ``closed_loop.compiled.loop`` does at it:

1. messages to the plant that were sent earlier and are due arrive, in the order of their leaving
2. the sensors sample, then the force on the rack is read
3. the controller decides, also about who steers
4. its answer arrives, if that takes no time
5. the hand wheel runs a cycle, and its state arrives, if that takes no time
"""

from collections.abc import Sequence
from enum import IntEnum
from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import Mode, SteeringForce
from ...hand_wheel.driver import kicks_n_m
from ...hand_wheel.feedback_laws import FEEDBACK_LAWS
from ...hand_wheel.modes import FeedbackMode, feedback_mode_step, good_message
from ...plant_emulator.network.settings import LatencySettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import BoolArray, FloatArray, IntArray
from ...runtime.node import NS_PER_S
from .law_input import Uplink
from .network import UPLINKS, Arrivals, ToPlant, arrivals_of, in_use_at, sensor_noise

if TYPE_CHECKING:
    from ...hand_wheel.settings import HandWheelSettings


OnBus = Sequence[tuple[int, int]]
"""Counter of each frame of a message, and when it was complete on the bus [ns]."""


class Event(IntEnum):
    """What happens, in the order of one instant; the late ones come in the order of leaving."""

    LATE_ANSWER = 0
    """HAND_WHEEL_FEEDBACK arrives that was sent before this instant."""
    LATE_STATE = 1
    """HAND_WHEEL_STATE arrives that was sent before this instant."""
    FORCE = 2
    """The force on the rack is read."""
    ANSWER = 3
    """HAND_WHEEL_FEEDBACK arrives without latency."""
    CYCLE = 4
    """The hand wheel runs a cycle."""
    STATE = 5
    """HAND_WHEEL_STATE arrives without latency."""


class WheelEvents(NamedTuple):
    """Events in order, then what is in use at each cycle or tick, -1 for none.

    ``ns``, ``kind``, ``number``  of each event; the number is that of a reading of the force, of a
                      cycle, or of a tick
    ``commands``      how many commands arrive before a late one
    ``ticks``         how many control ticks come before an event
    ``in_use``        sample of each ``Uplink`` that is in use at each cycle, -1 for none
    ``tick_cycle``    newest cycle that the controller has heard of at each tick
    ``tick_wheel``    sample whose STEERING_STATUS is the newest at each tick
    ``mode``, ``share``, ``kick_n_m``, ``cycle_tick``  at each cycle; the last is the newest tick
    """

    ns: IntArray
    kind: IntArray
    number: IntArray
    commands: IntArray
    ticks: IntArray
    in_use: IntArray
    tick_cycle: IntArray
    tick_wheel: IntArray
    mode: IntArray
    share: FloatArray
    kick_n_m: FloatArray
    cycle_tick: IntArray
    heading_noise_rad: FloatArray


def wheel_events(
    plant: PlantSettings,
    wheel: "HandWheelSettings",
    sample_ns: IntArray,
    tick_ns: IntArray,
    to_plant: ToPlant,
    statuses: Arrivals,
) -> WheelEvents:
    """Return the events of a run; ``statuses``: arrivals of STEERING_STATUS at the controller."""
    samples, end_ns, down = len(sample_ns), int(sample_ns[-1]), to_plant
    cycle_ns = np.arange(0, end_ns + 1, wheel.cycle_ns)
    force_ns = np.arange(0, end_ns + 1, plant.force_period_ns)
    is_command = down.kind == 0
    before = np.cumsum(is_command)[~is_command]
    came_ns, due_ns, kind, index = (
        column[~is_command] for column in (down.came_ns, down.due_ns, down.kind, down.number)
    )
    late = np.where(kind == 1, Event.LATE_ANSWER, Event.LATE_STATE)
    at_once = np.where(kind == 1, Event.ANSWER, Event.STATE)
    arrival = np.where(came_ns == due_ns, at_once, late)
    forces, cycles = np.arange(len(force_ns)), np.arange(len(cycle_ns))
    columns = (
        np.concatenate((due_ns, force_ns, cycle_ns)),
        np.concatenate((arrival, 0 * forces + Event.FORCE, 0 * cycles + Event.CYCLE)),
        np.concatenate((index, forces, cycles)),
        np.concatenate((before, 0 * forces, 0 * cycles)),
    )
    order = np.lexsort((np.maximum(columns[1], Event.LATE_STATE), columns[0]))
    ns, kinds, of, commands = (column[order].astype(np.int64) for column in columns)
    ticks = np.where(
        kinds < Event.ANSWER,
        np.searchsorted(tick_ns, ns, side="left"),
        np.searchsorted(tick_ns, ns, side="right"),
    )
    arrivals = [arrivals_of(each, plant, wheel.counters, samples, 0) for each in Uplink]
    reads = FEEDBACK_LAWS[wheel.feedback.law].reads
    road_ns = None if reads is None else arrivals[UPLINKS[reads]].arrival_ns
    mode, share = _modes(wheel, road_ns, cycle_ns)
    return WheelEvents(
        ns, kinds, of, commands, ticks,
        np.array([in_use_at(each, cycle_ns)[0] for each in arrivals]),
        np.searchsorted(cycle_ns, tick_ns, side="left") - 1,
        in_use_at(statuses, tick_ns)[0],
        mode,
        share,
        kicks_n_m(wheel.kicks, cycle_ns) + np.zeros(len(cycle_ns)),
        np.searchsorted(tick_ns, cycle_ns, side="right") - 1,
        sensor_noise(plant, samples, slice(1, 2))[0],
    )  # fmt: skip


def is_arrival(events: WheelEvents) -> BoolArray:
    """Return which events are messages that reach the plant."""
    return np.isin(events.kind, (Event.FORCE, Event.CYCLE), invert=True)


def felt_delay_s(plant: PlantSettings, wheel: "HandWheelSettings", events: WheelEvents) -> float:
    """Return how old the wheel's angle is that the felt torque answers, the mean of all cycles.

    NaN for a law that reads no road, and where none is ever felt.
    """
    reads = FEEDBACK_LAWS[wheel.feedback.law].reads
    if reads is None:
        return nan
    in_use, period_ns = events.in_use[UPLINKS[reads]], _road_period_ns(plant, wheel)
    is_state = np.isin(events.kind, (Event.LATE_STATE, Event.STATE))
    # The sensors come before an angle that arrives without latency, after any other one.
    known_ns = 2 * events.ns[is_state] + (events.kind[is_state] == Event.STATE)
    return _mean_age_s(wheel, in_use, 2 * period_ns * in_use, known_ns, events.number[is_state])


def felt_delay_on_bus_s(
    plant: PlantSettings, wheel: "HandWheelSettings", states: OnBus, roads: OnBus
) -> float:
    """Return the same of a run over a bus, on which frames wait, from its frames.

    ``states``, ``roads``  counters of HAND_WHEEL_STATE and of what the law reads, and when each was
                           complete on the bus [ns]

    NaN also where a latency varies or loses frames.
    """
    down, up = plant.latency.downlink, plant.latency.uplink
    is_constant = all(line == LatencySettings(mean_s=line.mean_s) for line in (down, up))
    if not (is_constant and states and roads):
        return nan
    (state, came_ns), (road, felt_ns) = (np.array(each, np.int64).T for each in (states, roads))
    state, road = (np.unwrap(each, period=COUNTERS) for each in (state, road))
    cycle_ns = np.arange(0, felt_ns[-1] + 1, wheel.cycle_ns)
    in_use = np.append(road, -1)[np.searchsorted(felt_ns, cycle_ns, side="right") - 1]
    known_ns = came_ns + round(down.mean_s * NS_PER_S)
    return _mean_age_s(wheel, in_use, in_use * _road_period_ns(plant, wheel), known_ns, state)


def _mean_age_s(
    wheel: "HandWheelSettings",
    in_use: IntArray,
    read_ns: IntArray,
    known_ns: IntArray,
    cycles: IntArray,
) -> float:
    """Return the mean age of the angle that the road in use at each cycle answers.

    ``in_use``, ``read_ns``   its number, -1 for none, and when the plant read it
    ``known_ns``, ``cycles``  when each angle was known there, and the cycle that it is of
    """
    angle = np.searchsorted(known_ns, read_ns, side="right") - 1
    felt = np.flatnonzero((in_use >= 0) & (angle >= 0))
    return float(np.mean(felt - cycles[angle[felt]])) * wheel.cycle_s if len(felt) else nan


def _road_period_ns(plant: PlantSettings, wheel: "HandWheelSettings") -> int:
    """Return the period with which the plant reads what the law does."""
    is_force = FEEDBACK_LAWS[wheel.feedback.law].reads is SteeringForce
    return plant.force_period_ns if is_force else plant.sensor_period_ns


def _modes(
    wheel: "HandWheelSettings", road_ns: IntArray | None, cycle_ns: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return mode and share of the law at each cycle; ``road_ns``: arrivals of what it reads."""
    rule = wheel.mode_params
    if road_ns is None:
        return np.full(len(cycle_ns), int(Mode.ACTIVE)), np.ones(len(cycle_ns))
    arrived = np.searchsorted(road_ns, cycle_ns, side="right")
    age_ns = cycle_ns - np.append(0, road_ns)[arrived]
    is_fresh = (arrived > 0) & (age_ns <= rule.timeout_ns)
    is_active = np.maximum.accumulate(is_fresh)
    if (is_active == is_fresh).all():
        modes = np.where(is_active, int(Mode.ACTIVE), int(Mode.WAITING))
        return modes, is_active.astype(np.float64)
    x, done, found = FeedbackMode(Mode.WAITING, 0), 0, []
    for now_ns, count in zip(cycle_ns.tolist(), arrived.tolist(), strict=True):
        for at_ns in road_ns[done:count].tolist():
            x = good_message(rule, x, at_ns)
        done, x = count, feedback_mode_step(rule, x, now_ns)
        found.append((int(x.mode), x.share))
    codes, shares = zip(*found, strict=True)
    return np.array(codes), np.array(shares)
