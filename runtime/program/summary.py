"""The summary of a run, in a few lines."""

from collections.abc import Iterator, Mapping
from typing import Any


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
    if host["steal_fraction"]:
        yield f"{100.0 * host['steal_fraction']:.1f} % of the processor time went to other guests"


def _connection_lines(connection: Mapping[str, Any]) -> Iterator[str]:
    if connection["outages"]:
        yield (
            f"bus lost {connection['outages']}x, back {connection['reconnections']}x; "
            f"it was away for {connection['outage_s']:.2f} s"
        )
    if connection["error_frames"]:
        yield f"error frames by cause: {causes_line(connection['error_frames'])}"
    if connection["frames_dropped"]:
        yield f"{connection['frames_dropped']} frames came faster than they were read, and are lost"


def _recording_lines(recording: Mapping[str, Any]) -> Iterator[str]:
    yield f"{recording['frames']} frames recorded in {recording['file']}"
    if recording["dropped"]:
        yield f"{recording['dropped']} frames not recorded: the recorder did not keep up"
    if recording["left_out"]:
        yield f"{recording['left_out']} frames not recorded: the format has no place for them"
