"""Orders of the visitor: from the page, in a file that two processes map, or from a USB wheel.

A USB steering wheel is read and moved by Linux's evdev. Between it and the emulated hand wheel is
the visitor's grip, a spring and a damper. What they put on the emulated wheel acts on the real one
the other way: the virtual coupling of Colgate, Stanley and Brown, Issues in the haptic display of
tool use, IROS 1995.
"""

import errno
import importlib
import math
import mmap
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...hand_wheel.wheel import GRIPS
from ...runtime.exit_status import cause_of
from ...runtime.node import NS_PER_MS
from ...runtime.settings import SettingsError

RELEASED_NS = 500 * NS_PER_MS
"""After so long without a report of the page no one steers."""
HAND_WHEELS: Mapping[str, Mapping[str, Any]] = {
    "hand_wheel": {"law": "rack_force", "damping_n_m_s": 0.0},
    "hand_wheel_damped": {"law": "rack_force", "damping_n_m_s": 0.5},
    "hand_wheel_cdob": {"law": "cdob", "damping_n_m_s": 0.0},
}
"""In place of a controller's preset: the hand wheel by which the visitor steers, with its feedback.

The damping is chosen."""
HANDS_OFF = "hands_off"
_CONTENT = struct.Struct("=qdqdq")
_EMPTY = _CONTENT.pack(-RELEASED_NS, 0.0, 0, 0.0, -1)
TURN_RAD = math.radians(900.0)
"""From stop to stop; chosen, as most wheels do by default."""
FULL_N_M = 2.5
"""Torque for which the device is asked for all it has; chosen, that of a wheel with a belt."""
_PERIOD_NS = 4 * NS_PER_MS
"""Between two forces: a USB wheel takes no more than one in a few milliseconds."""
_HELD_MS = 100
"""A force that is not renewed ends after this."""
_LEVEL_MAX = 0x7FFF
_TO_THE_LEFT = 0x4000
"""Of a positive level, by the kernel's documentation."""


class Orders(NamedTuple):
    """What the visitor does: angle of the front wheels, one of GRIPS, speed, one of HAND_WHEELS.

    ``wheel``  empty: the one that the hand began with
    """

    steer_rad: float = 0.0
    grip: str = "light"
    speed_m_s: float = 0.0
    wheel: str = ""


class HandFile:
    """The newest orders, with their time on this machine's monotonic clock [ns]."""

    lag_s = 0.03
    """Between two reports of the page the hands move on smoothly."""

    def __init__(self, path: Path) -> None:
        """Map a file, and make it if there is none."""
        if not path.exists():
            path.write_bytes(_EMPTY)
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _CONTENT.size)

    def write(self, orders: Orders, now_ns: int) -> None:
        """Leave the orders."""
        grip, wheel = [*GRIPS].index(orders.grip), ["", *HAND_WHEELS].index(orders.wheel) - 1
        self._map[:] = _CONTENT.pack(now_ns, orders.steer_rad, grip, orders.speed_m_s, wheel)

    def let_go(self) -> None:
        """Leave no orders, at once."""
        self._map[:] = _EMPTY

    def read(self, now_ns: int) -> Orders | None:
        """Return the orders; None when no one steers."""
        time_ns, steer_rad, grip, speed_m_s, wheel = _CONTENT.unpack(self._map[:])
        if now_ns - time_ns >= RELEASED_NS:
            return None
        return Orders(steer_rad, [*GRIPS][grip], speed_m_s, ["", *HAND_WHEELS][wheel + 1])

    def play(self, torque_n_m: float, now_ns: int) -> None:
        """Put a torque on the hands, to the left positive; a page cannot."""


class UsbWheel(HandFile):
    """The page's orders, with the angle of a device such as /dev/input/event5 in place of its own.

    ``ratio``  of the hand wheel to the front wheels

    Raises SettingsError for what is no wheel with a constant force, and without evdev.
    """

    lag_s = 0.004

    def __init__(self, path: Path, device: Path, ratio: float) -> None:
        super().__init__(path)
        self._evdev, self._wheel = open_wheel(device)
        self._turn_rad = TURN_RAD / ratio
        self._played_ns, self._effect = -_PERIOD_NS, -1

    def read(self, now_ns: int) -> Orders | None:
        """Return the orders; None when no one steers, or the device has gone."""
        orders = super().read(now_ns)
        if orders is None:
            return None
        try:
            axis = self._wheel.absinfo(self._evdev.ecodes.ABS_X)
        except OSError:
            return None
        share = (axis.value - axis.min) / (axis.max - axis.min)
        return orders._replace(steer_rad=(0.5 - share) * self._turn_rad)

    def play(self, torque_n_m: float, now_ns: int) -> None:
        """Put a torque on the device, to the left positive."""
        if now_ns - self._played_ns < _PERIOD_NS:
            return
        self._played_ns = now_ns
        ff, codes = self._evdev.ff, self._evdev.ecodes
        level = round(min(max(torque_n_m / FULL_N_M, -1.0), 1.0) * _LEVEL_MAX)
        force = ff.EffectType(ff_constant_effect=ff.Constant(level, ff.Envelope()))
        how = _TO_THE_LEFT, ff.Trigger(), ff.Replay(_HELD_MS, 0)
        try:
            effect = ff.Effect(codes.FF_CONSTANT, self._effect, *how, force)
            self._effect = self._wheel.upload_effect(effect)
            self._wheel.write(codes.EV_FF, self._effect, 1)
        except OSError:  # it has gone, and the force with it
            self._effect = -1


def open_wheel(device: Path) -> tuple[Any, Any]:
    """Return the package evdev, and the open device; raises SettingsError."""
    try:
        evdev = importlib.import_module("evdev")
    except ImportError as error:
        raise SettingsError("--usb-wheel needs Linux and evdev: pip install evdev") from error
    try:
        opened = evdev.InputDevice(str(device))
    except OSError as error:
        is_none = error.errno in (errno.ENOTTY, errno.EISDIR)
        what = "is no input device" if is_none else f"cannot be opened: {cause_of(error)}"
        raise SettingsError(f"--usb-wheel {device}: {what}") from error
    codes, able = evdev.ecodes, opened.capabilities()
    axis, forces = dict(able.get(codes.EV_ABS, ())).get(codes.ABS_X), able.get(codes.EV_FF, ())
    if axis is None or axis.min >= axis.max or codes.FF_CONSTANT not in forces:
        opened.close()
        what = "is no wheel with force feedback: it needs an axis X and a constant force"
        raise SettingsError(f"--usb-wheel {device}: {opened.name} {what}")
    return evdev, opened
