"""What the keys do: each changes the requested latency, and sends it."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ...dbc.messages import Direction, LatencyConfig, LatencyModel, limits

STEP_S = 0.01
LOSS_STEP = 0.01
QUIT_KEYS = ("q", "Q", "\x03", "\x04")
"""Ctrl-C and Ctrl-D too, where the terminal hands them over as keys."""
_MEAN_S_MAX = limits(LatencyConfig)["mean_s"].maximum
_SPREAD_S_MAX = limits(LatencyConfig)["spread_s"].maximum


class LatencyChoice(NamedTuple):
    """The latency that the monitor requests; none before the first key."""

    direction: Direction = Direction.BOTH
    model: LatencyModel = LatencyModel.NORMAL
    mean_s: float = 0.0
    spread_s: float = 0.0
    loss: float = 0.0

    def message(self) -> LatencyConfig:
        """Return the message that requests it from the plant."""
        return LatencyConfig(*self)


def pressed(choice: LatencyChoice, key: str) -> LatencyChoice | None:
    """Return the choice after a key; None for a key without effect."""
    change = _CHANGES.get(key)
    return None if change is None else change(choice)


def _mean(step_s: float) -> Callable[[LatencyChoice], LatencyChoice]:
    return lambda choice: choice._replace(mean_s=_moved(choice.mean_s, step_s, _MEAN_S_MAX))


def _spread(step_s: float) -> Callable[[LatencyChoice], LatencyChoice]:
    return lambda choice: choice._replace(spread_s=_moved(choice.spread_s, step_s, _SPREAD_S_MAX))


def _loss(step: float) -> Callable[[LatencyChoice], LatencyChoice]:
    return lambda choice: choice._replace(loss=_moved(choice.loss, step, 1.0))


def _moved(value: float, step: float, maximum: float) -> float:
    return round(min(max(value + step, 0.0), maximum), 4)


_CHANGES: Mapping[str, Callable[[LatencyChoice], LatencyChoice]] = {
    "+": _mean(STEP_S),
    "=": _mean(STEP_S),  # + without the shift key
    "up": _mean(STEP_S),
    "-": _mean(-STEP_S),
    "down": _mean(-STEP_S),
    "]": _spread(STEP_S),
    "right": _spread(STEP_S),
    "[": _spread(-STEP_S),
    "left": _spread(-STEP_S),
    ">": _loss(LOSS_STEP),
    ".": _loss(LOSS_STEP),
    "<": _loss(-LOSS_STEP),
    ",": _loss(-LOSS_STEP),
    "m": lambda choice: choice._replace(model=LatencyModel((choice.model + 1) % len(LatencyModel))),
    "d": lambda choice: choice._replace(direction=Direction(choice.direction % len(Direction) + 1)),
    "0": lambda choice: choice._replace(mean_s=0.0, spread_s=0.0, loss=0.0),
}
