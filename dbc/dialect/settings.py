"""The file of a car's dialect: which messages it has, and what their signals carry.

dbc = "my_car.dbc"                      # next to this file; DBC, ARXML, KCD, SYM
keep = ["LATERAL_ERROR"]                # messages of ours that stay on the bus

[messages.STEER_REQUEST]
sender = "controller"
cycle_ms = 10
signals.ANGLE = { carries = "steer_rad", unit = "deg", ratio = 17.0 }
signals.ACTIVE = { carries = "engaged" }
constants.TORQUE_MAX = 1.0
counter = "COUNTER"
checksum = { signal = "CHECKSUM", rule = "crc", polynomial = 0x1D, final_xor = 0xFF }
"""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Literal

from pydantic import Field

from ...runtime.node.end import End
from ...runtime.settings import Settings
from .checksum import Rule


class Quantity(StrEnum):
    """What a signal can carry, by its unit; the controller sends the first two."""

    STEER = "steer_rad"
    ENGAGED = "engaged"
    """1 while the controller is in control."""
    WHEEL_ANGLE = "wheel_angle_rad"
    APPLYING = "applying"
    """1 while the steering follows commands."""
    SPEED = "speed_m_s"
    YAW_RATE = "yaw_rate_rad_s"
    PREVIEW_CURVATURE = "preview_curvature_1_m"
    LATERAL_ERROR = "lateral_error_m"
    HEADING_ERROR = "heading_error_rad"


UNITS: Mapping[str, float] = {
    "SI": 1.0,
    "deg": 57.29577951308232,
    "deg/s": 57.29577951308232,
    "km/h": 3.6,
    "mph": 2.2369362920544025,
}
"""How many of each are one SI unit."""


CYCLE_MS_MIN, CYCLE_MS_MAX = 1.0, 60_000.0


class SignalSettings(Settings):
    """One signal: value = quantity in ``unit`` times ``ratio``, plus ``offset``."""

    carries: Quantity
    unit: Literal["SI", "deg", "deg/s", "km/h", "mph"] = "SI"
    ratio: float = 1.0
    """Of signal to quantity: the steering ratio for a hand wheel's angle; -1 turns the sign."""
    offset: float = Field(0.0, ge=-1e9, le=1e9)
    """In the signal's unit."""
    rate_max: float | None = Field(None, gt=0.0, le=1e6)
    """Of a command, in the signal's unit per second: what is faster is refused."""


class MessageSettings(Settings):
    """One message of the car."""

    sender: End = End.PLANT
    cycle_ms: float = Field(ge=CYCLE_MS_MIN, le=CYCLE_MS_MAX)
    signals: dict[str, SignalSettings] = Field(default_factory=dict)
    constants: dict[str, float | str] = Field(default_factory=dict)
    """Values of other signals, as numbers or by their names in the database; the rest is raw 0."""
    counter: str | None = None
    """Signal that is one more in every frame."""
    checksum: Rule | None = None


class DialectSettings(Settings):
    """The content of the file."""

    dbc: Path
    """Relative to the file."""
    keep: tuple[str, ...] = ()
    messages: dict[str, MessageSettings] = Field(min_length=1, max_length=500)
