"""The way back into control: how soon it has to come, and that nothing jumps on it.

The upper limit of the time to recover, for any settings under test, is the sum of:

    the fault is over, and the counters may continue elsewhere   the FTTI
    a run of rejected frames, then a run of good ones, ticks     RUN_FRAMES of the longer period
    the report of it passes both latency lines                   latencies, and their spread

On the way, from one sample or period to the next, the allowed steps are:

    the first command after a hold          from the held one, at most one period of its fade
    the wheel, at the first command that    from where it is, what its fade moves it, and further
    it follows again                        commands that arrive with the first
    the wheel, then                         what the commands do within the controller's rate limit,
                                            and its fade

A fade that a further silence interrupts continues by as much as it would have moved meanwhile:
``ramp_rad_s`` for the age limit, once.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from ....controller.settings import ControllerSettings
from ....dbc.messages import Mode, SteeringCommand, SteeringStatus, SteeringStatusCode, resolutions
from ....plant_emulator.settings import PlantSettings
from ....plant_emulator.steering.settings import resync_ns_of as plant_resync_ns_of
from ....runtime.node import NS_PER_S
from .campaign_file import PointSettings
from .node_watch import HELD_CODES, HELD_MODES

SIGMAS = 6.0
"""Multiple of a latency's jitter that is hardly ever exceeded."""
RUN_FRAMES = 12
"""Five rejected and the sixth, five good ones, and a tick."""
_COUNTERS = 1 << 16
_ON_WIRE_RAD = 2.0 * resolutions(SteeringStatus)["wheel_angle_rad"]
"""Both values of a difference are rounded."""


class Way(NamedTuple):
    """What a pair's settings allow on its way back.

    ``recovery_s``        from the end of a fault until both nodes are in control again
    ``command_fade_rad``  that the controller's fade moves a command in a period
    ``command_step_rad``  between two commands, whatever is wanted
    ``played_step_rad``   from sample to sample of a plan, 0 without
    ``ramp_rad_s``        of the plant's fade
    ``age_limit_s``       of the commands
    ``latency_s``         of both ways together, with its spread
    ``spread_s``          of one latency: with any, several commands may come through at once
    ``sensor_period_s``   from one of the plant's own messages to the next
    """

    recovery_s: float
    command_fade_rad: float
    command_step_rad: float
    played_step_rad: float
    ramp_rad_s: float
    age_limit_s: float
    latency_s: float
    spread_s: float
    control_period_s: float
    sensor_period_s: float


class Step(NamedTuple):
    """A change from one period to the next, and how much of it is allowed [rad].

    ``by_commands_rad``  share of ``allowed_rad`` due to further commands that came with it
    ``is_return``        whether it is the first after a hold
    """

    what: str
    step_rad: float
    allowed_rad: float
    by_commands_rad: float = 0.0
    is_return: bool = True

    @property
    def own_rad(self) -> float:
        """Part of the change that these commands do not explain [rad]."""
        return max(0.0, self.step_rad - self.by_commands_rad)

    @property
    def is_jump(self) -> bool:
        """Whether it exceeds what is allowed."""
        return self.step_rad > self.allowed_rad


def way_of(
    plant: PlantSettings, controller: ControllerSettings, point: PointSettings, ftti_s: float
) -> Way:
    """Return what the settings allow."""
    control_period_s = controller.period_ns / NS_PER_S
    sensor_period_s = plant.sensor_period_ns / NS_PER_S
    table = controller.supervision
    step_rad = controller.steer_limits.step_rad_max
    played_rad = step_rad * sensor_period_s / control_period_s
    latency_s = 1e-3 * (point.downlink_ms + point.uplink_ms + 2.0 * SIGMAS * point.jitter_ms)
    return Way(
        recovery_s=ftti_s + RUN_FRAMES * max(control_period_s, sensor_period_s) + latency_s,
        command_fade_rad=table.ramp_rad_s * control_period_s,
        command_step_rad=step_rad,
        played_step_rad=played_rad if controller.law_record.plan else 0.0,
        ramp_rad_s=plant.safety.ramp_rad_s,
        age_limit_s=plant_resync_ns_of(plant.safety) / NS_PER_S,
        latency_s=latency_s,
        spread_s=SIGMAS * 1e-3 * point.jitter_ms,
        control_period_s=control_period_s,
        sensor_period_s=sensor_period_s,
    )


def command_returns(way: Way, commands: Sequence[tuple[int, SteeringCommand]]) -> Iterator[Step]:
    """Yield the step of each first command after a hold or a stop."""
    for (_, before), (_, now) in pairwise(commands):
        if before.mode in HELD_MODES and now.mode is Mode.ACTIVE:
            allowed_rad = way.command_fade_rad + _ON_WIRE_RAD
            yield Step("command", abs(now.steer_rad - before.steer_rad), allowed_rad)


def wheel_steps(
    way: Way,
    statuses: Sequence[tuple[int, SteeringStatus]],
    sent: Sequence[tuple[int, SteeringCommand]],
    backlog_s: float,
) -> Iterator[Step]:
    """Yield the steps of the wheel from the first time on that it was held.

    A return is the first command that is followed after a fallback, or after a silence. With any
    other command the fade moves by as much as the time since the previous one allows.

    ``statuses``       the plant's own messages, and when they left the plant [ns]
    ``sent``       the commands, and when they were sent [ns]
    ``backlog_s``  for how long commands may have waited before the plant was handed them
    """
    was_held = was_fading = False
    changed_ns = statuses[0][0] if statuses else 0
    for (before_ns, before), (now_ns, now) in pairwise(statuses):
        if before.status in HELD_CODES:
            was_held = True
        else:
            was_fading = before.status is SteeringStatusCode.LIMITED_BY_SAFETY
        forward = (now.applied_counter - before.applied_counter) % _COUNTERS
        passed = min(forward, _COUNTERS - forward)
        since_s = (now_ns - (changed_ns if passed else before_ns)) / NS_PER_S
        changed_ns = now_ns if passed else changed_ns
        if not was_held:
            continue
        is_silent = since_s > way.age_limit_s + way.sensor_period_s + way.spread_s
        is_return = before.status in HELD_CODES and is_silent and passed > 0
        if is_return:
            back_s = way.latency_s + way.control_period_s + backlog_s
            from_ns = before_ns - round(back_s * NS_PER_S)
            # After the first command, further ones may be followed before the next sample.
            further = math.ceil(way.sensor_period_s / way.control_period_s) - 1
            by_commands_rad = further * way.command_step_rad + way.played_step_rad
            by_commands_rad += _crowd_rad(way, sent, from_ns, now_ns, backlog_s)
            fade_s = way.sensor_period_s + (way.age_limit_s if was_fading else way.control_period_s)
        else:
            by_commands_rad = passed * way.command_step_rad + way.played_step_rad
            lasted_s = min(since_s + way.spread_s, way.age_limit_s)
            fade_s = way.sensor_period_s + max(way.control_period_s, lasted_s)
        allowed_rad = by_commands_rad + way.ramp_rad_s * fade_s + _ON_WIRE_RAD
        step_rad = abs(now.wheel_angle_rad - before.wheel_angle_rad)
        yield Step("wheel", step_rad, allowed_rad, by_commands_rad, is_return)


def _crowd_rad(
    way: Way,
    sent: Sequence[tuple[int, SteeringCommand]],
    from_ns: int,
    to_ns: int,
    backlog_s: float,
) -> float:
    """Return by how much commands that may have come at the same time differ; 0 for one alone."""
    steers = [command.steer_rad for at_ns, command in sent if from_ns < at_ns <= to_ns]
    window_s = (to_ns - from_ns) / NS_PER_S - backlog_s
    if way.spread_s > 0.0 or len(steers) > math.ceil(window_s / way.control_period_s):
        return sum(abs(b - a) for a, b in pairwise(steers))
    return 0.0
