"""Reports of a run: settings, host, figures and how it ended; JSON for other programs."""

import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..node import NS_PER_S
from ..node.real_time import LoopFigures
from ..node.statistics import durations_report
from ..port.connection import ConnectionFigures
from ..settings import Settings
from .host import HostAnswer

DISTRIBUTION = "steer-by-wire-emulator"


def run_report(
    program: str,
    ended_by: str,
    bus: str,
    settings: Settings,
    loop: LoopFigures,
    node: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the report of one run; ``node`` is what the node itself reports."""
    return {
        "program": program,
        "version": version(DISTRIBUTION),
        "python": platform.python_version(),
        "ended_by": ended_by,
        "bus": bus,
        "settings": settings.model_dump(mode="json"),
        "loop": loop_report(loop),
        "node": dict(node),
    }


def loop_report(figures: LoopFigures) -> dict[str, Any]:
    """Return the figures of a real-time loop, times in seconds."""
    report = figures._asdict()
    duration_ns, busy_ns = report.pop("duration_ns"), report.pop("busy_ns")
    return report | {
        "lateness": durations_report(figures.lateness),
        "duration_s": duration_ns / NS_PER_S,
        "busy_fraction": busy_ns / duration_ns if duration_ns else 0.0,
    }


def connection_report(figures: ConnectionFigures) -> dict[str, Any]:
    """Return the figures of the connection to the bus, times in seconds."""
    report = figures._asdict()
    outage_ns = report.pop("outage_ns")
    return report | {"outage_s": outage_ns / NS_PER_S}


def host_report(answers: Sequence[HostAnswer], steal_fraction: float | None) -> dict[str, Any]:
    """Return what the host granted, and the share of processor time of other guests."""
    return {"answers": [answer._asdict() for answer in answers], "steal_fraction": steal_fraction}


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a file atomically; a number that is not finite becomes null.

    Raises OSError.
    """
    write_file(path, json_text(content).encode())


def write_file(path: Path, content: bytes) -> None:
    """Write a file atomically; raises OSError."""
    if path.is_symlink() or (path.exists() and not path.is_file()):
        # A link, a pipe or a device such as /dev/stdout is written to, never replaced.
        try:
            path.write_bytes(content)
        except OSError as error:  # errors of writing do not name the file
            raise OSError(error.errno, error.strerror, str(path)) from error
        return
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_bytes(content)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


def json_text(content: Mapping[str, Any]) -> str:
    """Return ``content`` as JSON; what is not finite becomes null."""
    return json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """Return ``value`` with None for every number that JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
