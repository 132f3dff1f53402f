"""How long frames wait for the bus, by identifier."""

from collections.abc import Mapping

from ..frame import EXTENDED, Frame
from ..node.statistics import DurationStatistics, DurationSummary

WATCHED_IDS_MAX = 256
"""The first identifiers on a channel; arbitration time and sender are recorded for these only."""


class ArbitrationDelays:
    """From submission to start of frame, of the first WATCHED_IDS_MAX identifiers."""

    def __init__(self) -> None:
        self._delays: dict[tuple[int, bool], DurationStatistics] = {}

    def record(self, frame: Frame, delay_ns: int) -> None:
        """Record the delay of a frame that wins the bus."""
        can_id, _, flags = frame
        key = (can_id, flags & EXTENDED != 0)
        statistics = self._delays.get(key)
        if statistics is None:
            if len(self._delays) >= WATCHED_IDS_MAX:
                return
            statistics = self._delays[key] = DurationStatistics()
        statistics.record(delay_ns)

    def summaries(self) -> Mapping[str, DurationSummary]:
        """Return them by identifier: 3 hexadecimal digits, or 8 for 29 bit."""
        return {
            f"{can_id:0{8 if is_extended else 3}X}": statistics.summary()
            for (can_id, is_extended), statistics in sorted(self._delays.items())
        }
