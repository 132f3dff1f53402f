"""The last line of a run of the suite: how many tests passed, failed, were skipped, and why."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any


def last_line(reports: Mapping[str, Sequence[Any]]) -> str:
    """Return one line of how many tests have passed, failed and been skipped, and why those."""
    numbers = {"passed": len(reports.get("passed", ())), "failed": len(reports.get("failed", ()))}
    numbers["errors"] = len(reports.get("error", ()))
    numbers["expected to fail"] = len(reports.get("xfailed", ()))
    said = [f"{count} {what}" for what, count in numbers.items() if count or what == "passed"]
    why = Counter(
        report.longrepr[2].removeprefix("Skipped: ") for report in reports.get("skipped", ())
    )
    reasons = "; ".join(f"{count}: {reason}" for reason, count in why.most_common())
    return ", ".join([*said, f"{why.total()} skipped"]) + (f" ({reasons})" if reasons else "")
