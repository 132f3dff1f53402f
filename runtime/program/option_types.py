"""Types of command line options that programs share; argparse turns their errors into one line.

Wrong options are reported before the run, so that none is lost because of them.
"""

import argparse
import os
from collections.abc import Callable
from importlib import resources
from pathlib import Path

from ..command_line import whole_number
from ..recording.recording import recording_obstacle
from ..settings import preset_names
from .host import PRIORITY_MAX

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


def add_json_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``, a file for the figures that are also printed."""
    parser.add_argument(
        "--json", type=output_file, metavar="FILE", help="also write the figures to a file"
    )


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


spin_us = whole_number(0, SPIN_US_MAX)
"""Reads how long to spin before a deadline [us]."""
priority = whole_number(0, PRIORITY_MAX)
"""Reads a priority of SCHED_FIFO, or 0."""
bit_rate = whole_number(10_000, 1_000_000)
"""Reads a bit rate as ISO 11898 allows it, of CAN FD the one of the arbitration [bit/s]."""
data_bit_rate = whole_number(10_000, 8_000_000)
"""Reads the bit rate of the data phase of CAN FD [bit/s]."""
