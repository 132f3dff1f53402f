"""The report of a run, as JSON and in a few lines."""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..output_file import write_text


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a file atomically; a number that is not finite becomes null.

    Raises OSError.
    """
    write_text(path, json_text(content))


def show_or_write(
    file: Path | None, content: Mapping[str, Any], show: Callable[[], object]
) -> None:
    """Show figures to a person, and write them to the FILE of ``--json``; raises OSError."""
    if file == Path("-"):
        print(json_text(content), end="")  # noqa: T201 - what was asked for
        return
    show()
    if file is not None:
        write_json(file, content)


def json_text(content: Mapping[str, Any]) -> str:
    """Return ``content`` as JSON; what is not finite becomes null."""
    return json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def durations_line(durations: Mapping[str, float]) -> str:
    """Return the median and the 99th percentile of durations in a report."""
    if not durations["samples"]:
        return "unknown"
    return f"p50 {1e3 * durations['p50_s']:.2f} ms, p99 {1e3 * durations['p99_s']:.2f} ms"


def causes_line(counts: Mapping[str, int]) -> str:
    """Return counts by cause in a report."""
    return ", ".join(f"{cause} {count}" for cause, count in counts.items())


def summary_lines(report: Mapping[str, Any]) -> Iterator[str]:
    """Return the lines of a report's summary, without events that did not happen."""
    loop, connection, host = report["loop"], report["connection"], report["host"]
    lateness = loop["lateness"]
    yield f"ended by {report['ended_by']} after {loop['duration_s']:.2f} s"
    yield f"{loop['frames_received']} frames received, {loop['frames_sent']} sent"
    yield (
        f"lateness p50 {1e3 * lateness['p50_s']:.3f} ms, p99 {1e3 * lateness['p99_s']:.3f} ms, "
        f"max {1e3 * lateness['max_s']:.3f} ms"
        if lateness["samples"]
        else "lateness unknown: no tick was due"
    )
    if loop["frames_refused"]:
        yield f"{loop['frames_refused']} frames not sent: the bus had no room for them, or was lost"
    yield from _connection_lines(connection)
    if report["recording"] is not None:
        yield from _recording_lines(report["recording"])
    refused = [f"{a['name']} ({a['detail']})" for a in host["answers"] if not a["got"]]
    if refused:
        yield f"refused by the host: {', '.join(refused)}"


def _connection_lines(connection: Mapping[str, Any]) -> Iterator[str]:
    if connection["error_frames"]:
        yield f"error frames by cause: {causes_line(connection['error_frames'])}"
    if connection["frames_dropped"]:
        yield f"{connection['frames_dropped']} frames came faster than they were read, and are lost"


def _recording_lines(recording: Mapping[str, Any]) -> Iterator[str]:
    frames, dropped = recording["frames"], recording["dropped"]
    if recording["failure"]:
        yield f"at least {frames} frames recorded in {recording['file']}"
        yield f"up to {dropped} frames not recorded: the recording has failed"
    else:
        yield f"{frames} frames recorded in {recording['file']}"
        if dropped:
            yield f"{dropped} frames not recorded: the recorder did not keep up"
