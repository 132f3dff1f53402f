"""The way back into control: how soon it has to come, and that nothing jumps on it.

At the latest, whatever the settings under test say:

    the fault is over, and the counters may go on elsewhere      the FTTI
    a run of refused frames, then a run of good ones, ticks      RUN_FRAMES control periods
    what tells it comes through both latency lines               latencies, and their spread

and on the way, from one sample or period to the next:

    the first command after a hold          is the held one, and a period of its fade away at most
    the wheel, at the first command that
    it follows again                        where it is, and as far away as its fade moves it, and
                                            further commands that come with the first
    the wheel, then                         what the commands do by the controller's limit of rate,
                                            and its fade

A fade that is broken off by a further silence goes on by as much as it would have moved meanwhile:
``ramp_rad_s`` for the age limit, once.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from controller.settings import ControllerSettings, limits_of
from dbc.messages import (
    Mode,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    resolutions,
)
from plant_emulator.safety_settings import resync_ns_of as plant_resync_ns_of
from plant_emulator.settings import PlantSettings
from runtime.node import NS_PER_S
from tools.campaign.specification import PointSettings

HELD_MODES = (Mode.HOLDING, Mode.SAFE_STOP)
HELD_CODES = (SteeringStatusCode.HOLDING, SteeringStatusCode.FALLBACK)
SIGMAS = 6.0
"""Of a latency's jitter, beyond which it hardly ever is."""
RUN_FRAMES = 12
"""Five refused and the sixth, five good ones, and a tick."""
_COUNTERS = 1 << 16
_ON_WIRE_RAD = 2.0 * resolutions(SteeringStatus)["wheel_angle_rad"]
"""Two values are rounded."""


class Way(NamedTuple):
    """What a pair's settings allow on its way back.

    ``recovery_s``        from the end of a fault until both nodes are in control again
    ``command_fade_rad``  that the controller's fade moves a command in a period
    ``command_step_rad``  between two commands, whatever is wanted
    ``ramp_rad_s``        of the plant's fade
    ``age_limit_s``       of the commands
    ``latency_s``         of both ways together, with its spread
    ``spread_s``          of one latency: with any, several commands may come through at once
    """

    recovery_s: float
    command_fade_rad: float
    command_step_rad: float
    ramp_rad_s: float
    age_limit_s: float
    latency_s: float
    spread_s: float
    period_s: float


class Step(NamedTuple):
    """A change from one period to the next, and how much of it is allowed [rad]."""

    what: str
    step_rad: float
    allowed_rad: float

    @property
    def is_jump(self) -> bool:
        """Whether it is more than is allowed."""
        return self.step_rad > self.allowed_rad


def way_of(
    plant: PlantSettings, controller: ControllerSettings, point: PointSettings, ftti_s: float
) -> Way:
    """Return what the settings allow."""
    period_s = controller.period_ns / NS_PER_S
    table = controller.supervision
    latency_s = 1e-3 * (point.downlink_ms + point.uplink_ms + 2.0 * SIGMAS * point.jitter_ms)
    return Way(
        recovery_s=ftti_s + RUN_FRAMES * period_s + latency_s,
        command_fade_rad=table.ramp_rad_s * period_s,
        command_step_rad=limits_of(controller).step_rad_max,
        ramp_rad_s=plant.safety.ramp_rad_s,
        age_limit_s=plant_resync_ns_of(plant.safety) / NS_PER_S,
        latency_s=latency_s,
        spread_s=SIGMAS * 1e-3 * point.jitter_ms,
        period_s=period_s,
    )


def command_returns(way: Way, commands: Sequence[tuple[int, SteeringCommand]]) -> Iterator[Step]:
    """Yield the step of each first command after a hold or a stop."""
    for (_, before), (_, now) in pairwise(commands):
        if before.mode in HELD_MODES and now.mode is Mode.ACTIVE:
            allowed_rad = way.command_fade_rad + _ON_WIRE_RAD
            yield Step("command", abs(now.steer_rad - before.steer_rad), allowed_rad)


def wheel_returns(
    way: Way,
    told: Sequence[tuple[int, SteeringStatus]],
    sent: Sequence[tuple[int, SteeringCommand]],
    backlog_s: float,
) -> Iterator[Step]:
    """Yield the step of the wheel at each first command that is followed again after a silence.

    Where more commands come at once than one, those that follow the first move it by themselves.

    ``told``       the plant's own messages, and when they left it [ns]
    ``sent``       the commands, and when they were sent [ns]
    ``backlog_s``  for how long commands may have waited before the plant was handed them
    """
    was_fading = False
    for (_, earlier), (before_ns, before), (now_ns, now) in zip(
        told, told[1:], told[2:], strict=False
    ):
        if earlier.status not in HELD_CODES:
            was_fading = earlier.status is SteeringStatusCode.LIMITED_BY_SAFETY
        is_silent = earlier.applied_counter == before.applied_counter
        if before.status not in HELD_CODES or not is_silent:
            continue
        if now.applied_counter == before.applied_counter:
            continue
        from_ns = before_ns - round((way.latency_s + way.period_s + backlog_s) * NS_PER_S)
        steers = [command.steer_rad for at_ns, command in sent if from_ns < at_ns <= now_ns]
        window_s = (now_ns - from_ns) / NS_PER_S - backlog_s
        is_crowd = way.spread_s > 0.0 or len(steers) > math.ceil(window_s / way.period_s)
        by_commands_rad = sum(abs(b - a) for a, b in pairwise(steers)) if is_crowd else 0.0
        fade_s = way.period_s + (way.age_limit_s if was_fading else way.period_s)
        allowed_rad = by_commands_rad + way.ramp_rad_s * fade_s + _ON_WIRE_RAD
        yield Step("wheel", abs(now.wheel_angle_rad - before.wheel_angle_rad), allowed_rad)


def wheel_moves(way: Way, told: Sequence[tuple[int, SteeringStatus]]) -> Iterator[Step]:
    """Yield the steps of the wheel from the first one held on, but those of its returns.

    With a command its fade moves by as much as the time since the one before allows.
    """
    was_held, changed_ns = False, 0
    for (before_ns, before), (now_ns, now) in pairwise(told):
        was_held = was_held or before.status in HELD_CODES
        forward = (now.applied_counter - before.applied_counter) % _COUNTERS
        passed = min(forward, _COUNTERS - forward)
        since_s = (now_ns - (changed_ns if passed else before_ns)) / NS_PER_S + way.spread_s
        changed_ns = now_ns if passed else changed_ns
        if not was_held or (before.status in HELD_CODES and passed):
            continue
        fade_s = way.period_s + max(way.period_s, min(since_s, way.age_limit_s))
        allowed_rad = passed * way.command_step_rad + way.ramp_rad_s * fade_s + _ON_WIRE_RAD
        yield Step("wheel", abs(now.wheel_angle_rad - before.wheel_angle_rad), allowed_rad)
