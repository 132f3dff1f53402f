"""Whether the memory of processes grows: at a run's start, middle and end, and in between."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

GROWTH_KIB_MAX = 512
"""Growth over half a run that still counts as flat: the bins of statistics, one at a time, and
pages that an allocator touches late."""
WARM_UP = 0.5
"""Share of the run after which growth is measured. Buffers grow with the longest stall so far, in
steps; a leak grows in the second half of a run as in the first."""


class MemoryFigures(NamedTuple):
    """Resident memory of one process [KiB].

    ``slope_kib_min``  of the straight line through the samples after the warm-up [KiB/min]
    ``growth_kib``     of that line, from the end of the warm-up to the end [KiB]
    ``is_flat``        whether it grew by no more than GROWTH_KIB_MAX
    """

    start_kib: int
    middle_kib: int
    end_kib: int
    slope_kib_min: float
    growth_kib: float
    is_flat: bool


class MemoryWatch:
    """Samples the memory of processes, by their names.

    ``samples``  time [s] and resident memory [KiB]
    """

    def __init__(self, processes: Mapping[str, int]) -> None:
        self._processes = processes
        self.samples: dict[str, list[tuple[float, int]]] = {name: [] for name in processes}

    def sample(self, time_s: float) -> None:
        """Take a sample of every process that still runs, at ``time_s`` since the start."""
        for name, pid in self._processes.items():
            kib = resident_kib(pid)
            if kib is not None:
                self.samples[name].append((time_s, kib))

    def figures(self) -> dict[str, MemoryFigures]:
        """Return the figures of every process that was seen."""
        return {name: figures_of(samples) for name, samples in self.samples.items() if samples}


def figures_of(samples: Sequence[tuple[float, int]]) -> MemoryFigures:
    """Return the figures of samples in order: time [s] and resident memory [KiB], at least one."""
    first, middle, last = samples[0], samples[len(samples) // 2], samples[-1]
    warm_s = first[0] + WARM_UP * (last[0] - first[0])
    rest = [sample for sample in samples if sample[0] >= warm_s]
    mean_s = sum(time_s for time_s, _ in rest) / len(rest)
    mean_kib = sum(kib for _, kib in rest) / len(rest)
    spread = sum((time_s - mean_s) ** 2 for time_s, _ in rest)
    slope = sum((time_s - mean_s) * (kib - mean_kib) for time_s, kib in rest)
    slope_kib_s = slope / spread if spread else 0.0
    growth_kib = slope_kib_s * (last[0] - rest[0][0])
    return MemoryFigures(
        first[1], middle[1], last[1], 60.0 * slope_kib_s, growth_kib, growth_kib <= GROWTH_KIB_MAX
    )


def resident_kib(pid: int) -> int | None:
    """Return the resident memory of a process [KiB]; None when it is gone. Linux only."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    found = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS:")]
    return int(found[0]) if found else None
