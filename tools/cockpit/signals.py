"""Signals that a page gets of each lane, and what it shows of them: signals, charts, figures.

The binary form in which rows go to a page: little-endian, a batch for each lane in one message.

header   kind (1) u8, lane u8, columns u16, rows u32
row      time [s] f64, columns f32
"""

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

ROW_PERIOD_S = 0.02
"""Between two rows of a live lane."""


class Signal(NamedTuple):
    """One column of a row; shown as ``scale`` times its value, in ``unit``."""

    name: str
    label: str
    unit: str = ""
    scale: float = 1.0
    digits: int = 0


class Chart(NamedTuple):
    """A strip chart.

    ``signals``    its lines where there is one lane
    ``of_lanes``   the signal drawn of each lane where there are several
    """

    title: str
    signals: tuple[str, ...]
    of_lanes: str


class Figure(NamedTuple):
    """A number that is always in view."""

    label: str
    signal: str
    explanation: str


SIGNALS: tuple[Signal, ...] = (
    Signal("lateral_error_m", "preview point", "mm", 1e3, 1),
    Signal("cg_deviation_m", "CG", "mm", 1e3, 1),
    Signal("heading_error_rad", "heading error", "mrad", 1e3, 1),
    Signal("steer_rad", "wanted", "mrad", 1e3, 1),
    Signal("steer_in_effect_rad", "in effect", "mrad", 1e3, 1),
    Signal("wheel_angle_rad", "applied", "mrad", 1e3, 1),
    Signal("speed_m_s", "speed", "km/h", 3.6, 1),
    Signal("yaw_rate_rad_s", "yaw rate", "°/s", math.degrees(1.0), 1),
    Signal("curvature_1_m", "curvature", "1/m", 1.0, 4),
    Signal("downlink_s", "commands", "ms", 1e3, 1),
    Signal("uplink_s", "measurements", "ms", 1e3, 1),
    Signal("round_trip_s", "round trip", "ms", 1e3, 1),
    Signal("echo_delay_s", "delay by echo", "ms", 1e3, 1),
    Signal("foot_x_m", "path x", "m", 1.0, 2),
    Signal("foot_y_m", "path y", "m", 1.0, 2),
    Signal("path_heading_rad", "path heading", "rad", 1.0, 3),
    Signal("ghost_m", "ghost", "m", 1.0, 2),
    Signal("ghost_heading_rad", "ghost heading", "rad", 1.0, 3),
    Signal("rms_m", "RMS of the car", "mm", 1e3, 2),
    Signal("peak_m", "peak of the car", "mm", 1e3, 2),
    Signal("hand_wheel_rad", "hand wheel", "rad", 1.0, 2),
    Signal("driver_torque_n_m", "driver", "N m", 1.0, 2),
    Signal("feedback_torque_n_m", "feedback", "N m", 1.0, 2),
    Signal("rack_force_n", "rack force", "N", 1.0, 0),
    Signal("front_grip_used", "grip front", "%", 100.0, 0),
    Signal("rear_grip_used", "grip rear", "%", 100.0, 0),
    Signal("front_load_share", "load in front", "%", 100.0, 1),
    Signal("lateral_acceleration_m_s2", "lateral acceleration", "m/s²", 1.0, 2),
)
NAMES = tuple(signal.name for signal in SIGNALS)

CHARTS: tuple[Chart, ...] = (
    Chart("Off the path", ("lateral_error_m", "cg_deviation_m"), "cg_deviation_m"),
    Chart("Steer", ("wheel_angle_rad", "steer_in_effect_rad", "steer_rad"), "wheel_angle_rad"),
    Chart("Latency", ("downlink_s", "uplink_s"), "downlink_s"),
    Chart("Round trip", ("round_trip_s",), "round_trip_s"),
)

OF_HAND_WHEEL: tuple[Chart, ...] = (
    Chart("Hand wheel", ("hand_wheel_rad",), "hand_wheel_rad"),
    Chart("Torque", ("driver_torque_n_m", "feedback_torque_n_m"), "feedback_torque_n_m"),
    Chart("Rack force", ("rack_force_n",), "rack_force_n"),
)
"""In place of round trip and latency, where there is one."""

FIGURES: tuple[Figure, ...] = (
    Figure("RMS", "rms_m", "root mean square of the car's deviation from the path since the start"),
    Figure("Peak", "peak_m", "largest deviation of the car from the path since the start"),
    Figure("Car", "cg_deviation_m", "deviation of the centre of gravity now, left positive"),
    Figure("Preview", "lateral_error_m", "error of the preview point now, left positive"),
    Figure("Round trip", "round_trip_s", "from a command to the first measurement that shows it"),
    Figure("Speed", "speed_m_s", "forward speed"),
)


def shown(*, has_hand_wheel: bool = False) -> Mapping[str, Any]:
    """Return signals, charts and figures, ready for JSON."""
    charts = (CHARTS[0], *OF_HAND_WHEEL) if has_hand_wheel else CHARTS
    return {
        "signals": [one._asdict() for one in SIGNALS],
        "charts": [one._asdict() for one in charts],
        "figures": [one._asdict() for one in FIGURES],
    }


_HEADER = struct.Struct("<BBHI")
_ROW = struct.Struct(f"<d{len(NAMES)}f")
_ROWS = 1


def packed_row(time_s: float, values: Sequence[float]) -> bytes:
    """Return one row."""
    return _ROW.pack(time_s, *values)


def packed_rows(lane: int, rows: Sequence[bytes]) -> bytes:
    """Return a batch of packed rows of one lane."""
    return _HEADER.pack(_ROWS, lane, len(NAMES), len(rows)) + b"".join(rows)
