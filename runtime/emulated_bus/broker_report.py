"""Report of a broker, as JSON and as one line: what it carried, whom it disconnected."""

from typing import Any

from ..node import NS_PER_S
from ..node.statistics import durations_report
from .broker import Broker


def broker_report(broker: Broker, duration_ns: int) -> dict[str, Any]:
    """Return the figures of a broker that has run for ``duration_ns``.

    ``lateness``      how long after an end of frame the broker came to deliver it
    ``traffic``       frames of the rest bus among all ``frames``
    ``load``          share of the time that a wire was busy, intermissions included
    ``held_back``     how often a client was not read on because its frames waited
    ``disconnected``  clients that are gone, by cause
    """
    return {
        "duration_s": duration_ns / NS_PER_S,
        "lateness": durations_report(broker.lateness),
        "channels": {
            name: {
                "frames": channel.load.frames,
                "traffic": channel.traffic_frames,
                "load": channel.load.busy_ns / duration_ns,
            }
            for name, channel in sorted(broker.channels.items())
        },
        "clients": {**broker.figures, "disconnected": dict(broker.disconnections)},
    }


def summary_line(report: dict[str, Any]) -> str:
    """Return the report in one line, without what did not happen."""
    parts = [f"ran {report['duration_s']:.1f} s"]
    for name, channel in report["channels"].items():
        parts.append(f"{name} {channel['frames']} frames, load {channel['load']:.1%}")
    clients = report["clients"]
    parts.append(f"{clients['served']} clients, {clients['most']} at once")
    gone = [
        f"{count} {cause.replace('_', ' ')}"
        for cause, count in clients["disconnected"].items()
        if count and cause != "left"
    ]
    if gone:
        parts.append(f"disconnected: {', '.join(gone)}")
    if clients["held_back"]:
        parts.append(f"held back {clients['held_back']}x")
    return "; ".join(parts)
