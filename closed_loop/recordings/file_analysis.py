"""Computes the figures of one log, which may be several files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...plant_emulator.evaluation.run_verdict import VerdictRules
from .analysis import LogAnalysis
from .bus_listener import Export
from .held_path import PREVIEW_M
from .log_file import LogError, open_log

PROGRESS_FRAMES = 5_000
"""Frames between two reports of progress."""


class AnalysedLog(NamedTuple):
    """The figures of a log, ready for JSON, and the data of its pictures."""

    figures: dict[str, Any]
    analysis: LogAnalysis


def analyse_files(
    paths: Sequence[Path],
    channel: str | None = None,
    exports: Sequence[Export] = (),
    advance: Callable[[str, float | None], None] = lambda _name, _fraction: None,
    rules: VerdictRules | None = None,
    preview_m: float = PREVIEW_M,
) -> AnalysedLog:
    """Read the files of one log, one after the other.

    ``channel``  the only one to analyse, where the log has several
    ``exports``  receive every message; the caller closes them
    ``advance``  called now and then with a file and how much of it was read (None: unknown)
    ``rules``    of the verdict
    ``preview_m``  where the plant's preview point is, ahead of the centre of gravity

    Raises LogError if a file cannot be read at all, or has no frame of the channel.
    """
    analysis = LogAnalysis(rules, preview_m)
    unreadable, first_unreadable = 0, ""
    channels: dict[str, None] = {}
    for path in paths:
        log = open_log(path)
        for number, (time_ns, its_channel, frame) in enumerate(log):
            if number % PROGRESS_FRAMES == 0:
                advance(str(path), log.fraction_read)
            channels[its_channel] = None
            if channel not in (None, its_channel):
                continue
            taken = analysis.take(time_ns, frame)
            if taken is not None:
                for export in exports:
                    export.write(time_ns, *taken)
        unreadable += log.unreadable
        first_unreadable = first_unreadable or log.first_unreadable
    figures = {
        "files": [str(path) for path in paths],
        "channels": sorted(filter(None, channels)),
        "unreadable": unreadable,
        "first_unreadable": first_unreadable,
        **analysis.figures(),
    }
    if channel is not None and not figures["frames"]:
        there = ", ".join(figures["channels"]) or "none is named"
        raise LogError(f"{paths[0]}: no frame of channel {channel}; in the log: {there}")
    return AnalysedLog(figures, analysis)
