"""Results by case, a row for each fault and magnitude."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from .virtual_trial import FAILURES, RunResult


class Group(NamedTuple):
    """The runs of one case; times are the longest, None where there is none.

    ``frti_s``     where control has to be left; ``safe_state`` is True there
    ``accepted``   share of the false frames that were accepted; None where there were none
    ``recovered``  how many of the runs were in control at the end
    """

    kind: str
    where: str
    magnitude: float
    expected: str
    why: str
    runs: int
    verdicts: str
    failures: int
    detected_by: str
    counted: str
    safe_state: bool
    accepted: float | None
    fdti_s: float | None
    frti_s: float | None
    fhti_s: float | None
    reported_s: float | None
    recovered: int
    recovery_s: float | None
    lateral_error_peak_m: float
    steer_rate_peak_rad_s: float


def group(results: Iterable[RunResult]) -> list[Group]:
    """Return a row for each case, in the order in which they first come.

    A case is split in two where a limiter detects it at some speeds only.
    """
    cases: dict[tuple[str, str, float, str], list[RunResult]] = {}
    for one in results:
        cases.setdefault((one.kind, one.where, one.magnitude, one.expected), []).append(one)
    return [_row(runs) for runs in cases.values()]


def _row(runs: Sequence[RunResult]) -> Group:
    first = runs[0]
    verdicts = Counter(run.verdict for run in runs)
    causes = Counter(run.detected_by.split(".")[-1] for run in runs if run.detected_by)
    counted = Counter(cause.split(".")[-1] for run in runs for cause in run.counts)
    false_frames = sum(run.false_frames for run in runs)
    recovered = [run.recovery_s for run in runs if run.recovery_s is not None]
    return Group(
        kind=first.kind,
        where=first.where,
        magnitude=first.magnitude,
        expected=first.expected,
        why=first.why,
        runs=len(runs),
        verdicts=", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items())),
        failures=sum(run.verdict in FAILURES for run in runs),
        detected_by=", ".join(cause for cause, _ in causes.most_common(2)),
        counted=", ".join(cause for cause, _ in counted.most_common(3)),
        safe_state=first.safe_state,
        accepted=sum(run.false_accepted for run in runs) / false_frames if false_frames else None,
        fdti_s=_longest(run.fdti_s for run in runs),
        frti_s=_longest(run.frti_s for run in runs if run.safe_state),
        fhti_s=_longest(run.fhti_s for run in runs),
        reported_s=_longest(run.reported_s for run in runs),
        recovered=len(recovered),
        recovery_s=_longest(recovered),
        lateral_error_peak_m=max(run.lateral_error_peak_m for run in runs),
        steer_rate_peak_rad_s=max(run.steer_rate_peak_rad_s for run in runs),
    )


def _longest(times_s: Iterable[float | None]) -> float | None:
    return max((time_s for time_s in times_s if time_s is not None), default=None)


def in_percent(share: float | None) -> str:
    """Return a share as text for the tables."""
    return "-" if share is None else f"{100.0 * share:.0f}"


def in_ms(time_s: float | None) -> str:
    """Return a time as text for the tables."""
    return "-" if time_s is None else f"{1e3 * time_s:.0f}"
