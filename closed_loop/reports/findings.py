"""Findings: what was to be shown or looked for, whether it holds, and by which figure."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple


class Finding(NamedTuple):
    """A property that was looked for, and the figure that shows it.

    ``holds``   None where nothing could show it
    ``advice``  what to do where it is wanted and does not hold; empty for nothing
    """

    what: str
    holds: bool | None
    figure: str
    advice: str = ""


HOLDS: Mapping[bool | None, str] = {True: "ok", False: "NO", None: "-"}
"""What is printed for a finding."""


def finding_lines(findings: Sequence[Finding]) -> list[str]:
    """Return a line for each finding, with what to do below it."""
    width = max(len(finding.what) for finding in findings)
    lines = []
    for what, holds, figure, advice in findings:
        lines.append(f"{HOLDS[holds]:2} {what:{width}}  {figure}")
        if advice:
            lines.append(f"   {'':{width}}  do: {advice}")
    return lines
