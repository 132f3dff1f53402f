"""The keys of the monitor: read without waiting for a line; each changes the latency asked for."""

import os
import re
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from ...dbc.messages import Direction, LatencyConfig, LatencyModel, limits

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_KEY = re.compile(r"\x1b[\[O]([A-D])|\x1b(?:[\[O][0-9;?]*[@-~])?|(.)", re.DOTALL)
"""An arrow, another escape sequence, or one character."""


def keys_in(text: str) -> list[str]:
    """Return the keys in what a terminal has sent; those without a name here are left out."""
    found = (_ARROWS.get(arrow, character) for arrow, character in _KEY.findall(text))
    return [key for key in found if key]


@contextmanager
def terminal_keys() -> Iterator[Callable[[], list[str]]]:
    """Yield a function that returns the keys pressed since its last call: none without terminal."""
    if not sys.stdin.isatty():
        yield list
    elif sys.platform == "win32":
        yield _windows_keys
    else:
        import termios  # only Unix has it
        import tty

        descriptor = sys.stdin.fileno()
        before = termios.tcgetattr(descriptor)
        try:
            # Keys are read at once and without echo; Ctrl-C and Ctrl-Z remain signals.
            tty.setcbreak(descriptor)
            yield lambda: _unix_keys(descriptor)
        finally:
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _unix_keys(descriptor: int) -> list[str]:
    readable, _, _ = select.select([descriptor], [], [], 0.0)
    return keys_in(os.read(descriptor, 64).decode("utf-8", "replace")) if readable else []


def _windows_keys() -> list[str]:
    keys: list[str] = []
    if sys.platform == "win32":
        import msvcrt

        arrows = {"H": "up", "P": "down", "M": "right", "K": "left"}
        while msvcrt.kbhit():
            key = msvcrt.getwch()
            keys.append(arrows.get(msvcrt.getwch(), "") if key in "\x00\xe0" else key)
    return keys


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
    match key:
        case "+" | "=" | "up":  # = is + without the shift key
            return choice._replace(mean_s=_moved(choice.mean_s, STEP_S, _MEAN_S_MAX))
        case "-" | "down":
            return choice._replace(mean_s=_moved(choice.mean_s, -STEP_S, _MEAN_S_MAX))
        case "]" | "right":
            return choice._replace(spread_s=_moved(choice.spread_s, STEP_S, _SPREAD_S_MAX))
        case "[" | "left":
            return choice._replace(spread_s=_moved(choice.spread_s, -STEP_S, _SPREAD_S_MAX))
        case ">" | ".":
            return choice._replace(loss=_moved(choice.loss, LOSS_STEP, 1.0))
        case "<" | ",":
            return choice._replace(loss=_moved(choice.loss, -LOSS_STEP, 1.0))
        case "m":
            return choice._replace(model=LatencyModel((choice.model + 1) % len(LatencyModel)))
        case "d":
            return choice._replace(direction=Direction(choice.direction % len(Direction) + 1))
        case "0":
            return choice._replace(mean_s=0.0, spread_s=0.0, loss=0.0)
    return None


def _moved(value: float, step: float, maximum: float) -> float:
    return round(min(max(value + step, 0.0), maximum), 4)
