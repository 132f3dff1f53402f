"""Trace of the hand wheel: one row a cycle, as CSV."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from ..runtime.output_file import write_text
from .node import HandWheelSample

SAMPLES_MAX = 10_000_000
"""Of one run."""


def write_hand_wheel_trace(file: Path, samples: Sequence[HandWheelSample]) -> None:
    """Write the samples with the names of their fields, units last; raises OSError."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(HandWheelSample._fields)
    rows.writerows((*sample[:-2], sample.mode.name, sample.steered_by.name) for sample in samples)
    write_text(file, text.getvalue())
