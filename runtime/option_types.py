"""Types of command line options that programs share; argparse turns their errors into one line.

Wrong options are reported before the run, so that none is lost because of them.
"""

import argparse
import math
import os
from collections.abc import Callable
from importlib import resources
from pathlib import Path

from .host import PRIORITY_MAX
from .recording import recording_obstacle
from .settings import preset_names

DURATION_S_MAX = 1e9
SPIN_US_MAX = 10_000


def output_file(text: str) -> Path:
    """Read the name of a file to write after the run."""
    path = Path(text)
    try:
        if path.is_dir():
            raise argparse.ArgumentTypeError(f"{text} is a directory")
        if not path.parent.is_dir():
            raise argparse.ArgumentTypeError(f"there is no directory {path.parent}")
    except OSError as error:  # not a possible file name
        raise argparse.ArgumentTypeError(f"{text[:60]}: {error.strerror}") from error
    if not all(os.access(place, os.W_OK) for place in (path.parent, path) if place.exists()):
        raise argparse.ArgumentTypeError(f"{text} may not be written")
    return path


def recording_file(text: str) -> Path:
    """Read the name of a recording."""
    path = output_file(text)
    if obstacle := recording_obstacle(path):
        raise argparse.ArgumentTypeError(obstacle)
    return path


def settings_file(package: str) -> Callable[[str], Path]:
    """Return the type of an option that takes a TOML file, or one of ``package`` by its name."""

    def read(text: str) -> Path:
        if text.endswith(".toml") or os.path.exists(text):
            return Path(text)
        names = preset_names(package)
        if text not in names:
            raise argparse.ArgumentTypeError(
                f"{text[:60]!r} is neither a .toml file nor one of {', '.join(names)}"
            )
        return Path(str(resources.files(package) / f"{text}.toml"))

    return read


def seconds(text: str) -> float:
    """Read a duration [s]."""
    try:
        value_s = float(text)
    except ValueError:
        value_s = math.nan
    if not 0.0 < value_s < DURATION_S_MAX:
        raise argparse.ArgumentTypeError(f"allowed is above 0 to {DURATION_S_MAX:g}, not {text!r}")
    return value_s


def spin_us(text: str) -> int:
    """Read how long to spin before a deadline [us]."""
    return _whole(text, SPIN_US_MAX)


def priority(text: str) -> int:
    """Read a priority of SCHED_FIFO, or 0."""
    return _whole(text, PRIORITY_MAX)


def bit_rate(text: str) -> int:
    """Read a bit rate [bit/s]."""
    if not text.isdecimal() or not 10_000 <= int(text) <= 8_000_000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a bit rate of 10000 to 8000000 bit/s")
    return int(text)


def _whole(text: str, maximum: int) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) <= maximum):
        raise argparse.ArgumentTypeError(f"allowed is 0 to {maximum}, not {text!r}")
    return int(text)
