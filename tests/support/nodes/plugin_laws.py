"""Laws as a stranger may write them: right, wrong, and in need of what numba does not have."""

import json
from typing import NamedTuple

from pydantic import Field

from steer_by_wire.controller.law_interface import Schedule
from steer_by_wire.controller.laws import Law, LawInput, LawOutput, last_command
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.runtime.settings import Settings


class Gain(NamedTuple):
    gain_rad_m: float


# Each law has params of its own, by whose type compiled runs tell them apart.
OtherGain, ThirdGain, FourthGain, StandingGain, Countdown, MappedGain = (
    NamedTuple(f"Gain{number}", [("gain_rad_m", float)]) for number in range(6)
)


class Asleep(NamedTuple):
    ticks_left: float


def at_rest(_params: Gain, _lateral_error_m: float) -> Asleep:
    return Asleep(50.0)


def design(_settings: LawSettings) -> Gain:
    return Gain(1.0)


def _steer(p: Gain, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    steer_rad = -p.gain_rad_m * observed.lateral_error_m
    return Asleep(max(0.0, x.ticks_left - 1.0)), LawOutput(steer_rad, 0.0, 0.0, 0.0)


def divide_later(p: Gain, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    after, output = _steer(p, x, observed)
    return after, LawOutput(output.steer_rad, 1.0 / x.ticks_left, 0.0, 0.0)


DIVIDES = Law(divide_later, at_rest, design)


def no_number_later(p: Countdown, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    after, output = _steer(Gain(*p), x, observed)
    estimate = float("nan") if x.ticks_left == 0.0 else 0.0
    return after, LawOutput(output.steer_rad, estimate, 0.0, 0.0)


NOT_A_NUMBER = Law(no_number_later, at_rest, lambda _settings: Countdown(1.0))


def through_json(p: OtherGain, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    steer_rad = -json.loads(json.dumps(p.gain_rad_m * observed.lateral_error_m))
    return x, LawOutput(steer_rad, 0.0, 0.0, 0.0)


NOT_COMPILED = Law(through_json, at_rest, lambda _settings: OtherGain(1.0))


def import_inside(p: ThirdGain, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    import math  # what numba has no bytecode for

    return x, LawOutput(-math.tanh(p.gain_rad_m * observed.lateral_error_m), 0.0, 0.0, 0.0)


IMPORTS = Law(import_inside, at_rest, lambda _settings: ThirdGain(1.0))


def call_with_keywords(p: FourthGain, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    many = (lambda *gains, **_more: gains[0])(p.gain_rad_m, more=1.0)
    return x, LawOutput(-many * observed.lateral_error_m, 0.0, 0.0, 0.0)


KEYWORDS = Law(call_with_keywords, at_rest, lambda _settings: FourthGain(1.0))
"""numba fails in an assertion of its own."""


def through_map(p: MappedGain, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    def half(error_m: float) -> float:
        return 0.5 * error_m

    steer_rad, error_m = 0.0, observed.lateral_error_m
    for half_m in map(half, (error_m, error_m)):
        steer_rad -= p.gain_rad_m * half_m
    return x, LawOutput(steer_rad, 0.0, 0.0, 0.0)


MAPS = Law(through_map, at_rest, lambda _settings: MappedGain(1.0))

BORROWED = Law(through_json, at_rest, design)
"""With the params of another law."""


def raise_when_designed(_settings: LawSettings) -> Gain:
    raise ZeroDivisionError("no gain")


NO_DESIGN = Law(_steer, at_rest, raise_when_designed)


def no_output(_p: Gain, x: Asleep, _observed: LawInput) -> tuple[Asleep, LawOutput]:
    return x, None


NO_OUTPUT = Law(no_output, at_rest, design, commands_read=last_command)


def raise_at_rest(_params: Gain, _lateral_error_m: float) -> Asleep:
    raise RuntimeError("no rest")


NO_REST = Law(_steer, raise_at_rest, design)


class NeedsTable(Settings):
    gain_rad_m: float = Field(gt=0.0, le=10.0)


NEEDS_TABLE = Law(
    _steer,
    at_rest,
    lambda settings: Gain(settings.table_of(NeedsTable).gain_rad_m),
    settings=NeedsTable,
)

PLAIN = {"step": _steer}


def at_a_stand_only(speed_m_s: float) -> StandingGain:
    if speed_m_s > 0.0:
        raise ZeroDivisionError("no gain at this speed")
    return StandingGain(1.0)


def steer_at_a_stand(p: StandingGain, x: Asleep, observed: LawInput) -> tuple[Asleep, LawOutput]:
    return x, LawOutput(-p.gain_rad_m * observed.lateral_error_m, 0.0, 0.0, 0.0)


NO_SCHEDULE = Law(steer_at_a_stand, at_rest, lambda _settings: Schedule(at_a_stand_only))
"""Its design works, and it fails on the first speed that it hears."""
