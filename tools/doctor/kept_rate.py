"""The rule by which a machine keeps a control rate."""

from collections.abc import Sequence

from ...runtime.node import NS_PER_S
from .wake_ups import WakeUps

LATENESS_SHARE_MAX = 0.1
"""Share of the period, for 99 of 100 wake-ups: beyond it, the law's samples are no longer equally
spaced."""
DONE_SHARE_MAX = 0.5
"""Share of the period, for 99 of 100 ticks: the other half is for frames, and a reserve."""
MISSED_SHARE_MAX = 0.001
"""Share of all periods: any machine stalls at times, and a controller continues on its grid."""
RULE = (
    "a rate is kept if at most one period in a thousand is missed, 99 of 100 wake-ups are late by "
    "at most a tenth of the period, and 99 of 100 ticks are done within half of it"
)


def is_kept(wake_ups: WakeUps) -> bool:
    """Whether the machine keeps this rate."""
    figures, period_ns = wake_ups.figures, NS_PER_S / wake_ups.rate_hz
    served = figures.lateness.samples
    return (
        served > 0
        and figures.missed <= MISSED_SHARE_MAX * (served + figures.missed)
        and figures.lateness.p99_ns <= LATENESS_SHARE_MAX * period_ns
        and figures.done.p99_ns <= DONE_SHARE_MAX * period_ns
    )


def rate_kept_hz(measurements: Sequence[WakeUps]) -> int | None:
    """Return the highest rate that is kept together with all lower ones; None without any."""
    kept = None
    for wake_ups in sorted(measurements, key=lambda each: each.rate_hz):
        if not is_kept(wake_ups):
            break
        kept = wake_ups.rate_hz
    return kept
