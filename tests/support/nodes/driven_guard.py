"""A guard that is given commands and wheel angles, with a timer that is always on time."""

import math
from collections.abc import Iterable
from typing import NamedTuple

from steer_by_wire.plant_emulator.steering.hold_and_fallback import (
    OFF_NS,
    GuardParams,
    guard_command,
    guard_rejection,
    guard_timer,
    guard_wheel,
    start_guard,
)
from steer_by_wire.plant_emulator.steering.safety_limiter import LimiterParams, limit_table

MS_NS = 1_000_000
INF = math.inf
MODES = ["NO_COMMAND", "FOLLOWING", "HOLDING", "FALLBACK", "SAFE_STATE"]


class Guarded:
    """A guard that is given commands and wheel angles at times in ms; its timer is on time."""

    def __init__(
        self,
        hold_ms: float = 500.0,
        recovery_frames: int = 3,
        ramp_step_rad: float = 0.03125,
        override_ms: float | None = None,
        plan_ms: float = 300.0,
    ) -> None:
        self.p = GuardParams(
            limiter=LimiterParams(limit_table(1.0, INF, INF, INF, INF), 0.125, 100 * MS_NS, INF),
            silence_ns=140 * MS_NS,
            plan_ns=round(plan_ms * MS_NS),
            hold_ns=round(hold_ms * MS_NS),
            recovery_frames=recovery_frames,
            ramp_rad_s=0.5,
            ramp_step_rad=ramp_step_rad,
            override_ns=OFF_NS if override_ms is None else round(override_ms * MS_NS),
        )
        self.x = start_guard(self.p)
        self.followed_ns = 0
        self.log: list[tuple[float, str, float]] = []
        self.set_anew: list[bool] = []

    def until(self, time_ms: float) -> None:
        """Let the timer do all that is due up to and at this time."""
        while self.x.deadline_ns <= time_ms * MS_NS:
            now_ns = self.x.deadline_ns
            self.x, is_set = guard_timer(self.p, self.x, now_ns)
            self.set_anew.append(is_set)
            self._note(now_ns)
            assert len(self.log) < 200, "a timer that is due for ever"

    def command(self, time_ms: float, steer_rad: float) -> bool:
        """Take a command, before what the timer has to do at that time."""
        self.until(time_ms - 1e-6)
        self.x, is_followed = guard_command(self.p, self.x, steer_rad, round(time_ms * MS_NS))
        return is_followed

    def plan_value(self, time_ms: float, steer_rad: float) -> bool:
        """Take a later value of a plan, after what the timer has to do at that time."""
        self.until(time_ms)
        self.x, is_followed = guard_command(
            self.p, self.x, steer_rad, round(time_ms * MS_NS), is_new=False
        )
        return is_followed

    def damaged(self) -> None:
        """Take a command that came damaged."""
        self.x = guard_rejection(self.x)

    def wheel(self, time_ms: float, wheel_rad: float) -> None:
        self.until(time_ms)
        self.x, self.followed_ns = guard_wheel(
            self.p, self.x, self.followed_ns, wheel_rad, round(time_ms * MS_NS)
        )

    @property
    def mode(self) -> str:
        return MODES[self.x.mode]

    @property
    def target(self) -> float:
        return self.x.limiter.steer_rad

    def _note(self, now_ns: int) -> None:
        self.log.append((now_ns / MS_NS, self.mode, self.target))


def steady(guarded: Guarded, steer_rad: float) -> None:
    """Commands every 10 ms until 100 ms."""
    for time_ms in range(0, 101, 10):
        assert guarded.command(time_ms, steer_rad)


class Answer(NamedTuple):
    """Whether a command is followed, and what decides about the target from it on."""

    is_followed: bool
    mode: int


def answers_to(p: GuardParams, commands: Iterable[tuple[int, bool]]) -> list[Answer]:
    """Return the guard's answers to commands, if the wheel follows.

    They depend on nothing but times, so they can be known before a run.

    ``commands``  when each arrives [ns], and whether it is sent at that instant: the timer is first
    """
    x = start_guard(p)
    answers = []
    for time_ns, is_sent_then in commands:
        while x.deadline_ns < time_ns + is_sent_then:
            x, _ = guard_timer(p, x, x.deadline_ns)
        x, is_followed = guard_command(p, x, 0.0, time_ns)
        answers.append(Answer(is_followed, x.mode))
    return answers
