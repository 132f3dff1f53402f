"""Reads keys from a terminal without waiting for a line, and restores the terminal afterwards."""

import os
import re
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_KEY = re.compile(r"\x1b[\[O]([A-D])|\x1b(?:[\[O][0-9;?]*[@-~])?|(.)", re.DOTALL)
"""An arrow, another escape sequence, or one character."""


def keys_in(text: str) -> list[str]:
    """Return the keys in what a terminal has sent; those without a name here are left out."""
    keys = []
    for arrow, character in _KEY.findall(text):
        if arrow:
            keys.append(_ARROWS[arrow])
        elif character:
            keys.append(character)
    return keys


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
