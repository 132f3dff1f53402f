"""What a broker has carried and which clients it disconnected: as one line, and as JSON."""

from typing import Any

from ..bus_model.bus_errors import BusErrors
from ..node import NS_PER_S
from ..node.statistics import durations_report
from .broker import Broker
from .journal import Journal


def broker_report(broker: Broker, journal: Journal, duration_ns: int) -> dict[str, Any]:
    """Return the figures of a broker that has run for ``duration_ns``.

    ``lateness``           how long after an end of frame the broker came to deliver it
    ``traffic``            frames of the rest bus among all ``frames``
    ``load``               share of the time that a wire was busy, intermissions included
    ``discarded``          frames of clients that had gone which were never sent
    ``bus_offs``           how often a client has gone into bus-off; ``lost_in_bus_off`` its frames
    ``errors``             destroyed transmissions by cause; with frames received twice and missed
    ``arbitration_delay``  from when the broker read a frame to its start of frame, by identifier
    ``held_back``          how often a client was not read on because its frames waited
    ``disconnected``       clients that are gone, by cause
    ``unprinted``          lines that were not printed, because they came too fast or nobody read
    """
    return {
        "duration_s": duration_ns / NS_PER_S,
        "lateness": durations_report(broker.lateness),
        "channels": {
            name: {
                "frames": channel.load.frames,
                "traffic": channel.traffic_frames,
                "load": channel.load.busy_ns / duration_ns,
                "discarded": channel.departed.discarded,
                "bus_offs": channel.bus_offs,
                "lost_in_bus_off": channel.lost_in_bus_off,
                **_errors(channel.errors),
                "arbitration_delay": {
                    can_id: durations_report(delay)
                    for can_id, delay in channel.delays.summaries().items()
                },
            }
            for name, channel in sorted(broker.channels.items())
        },
        "clients": {
            **broker.clients.figures._asdict(),
            "disconnected": dict(journal.disconnections),
            "unprinted": journal.unprinted,
        },
    }


def _errors(errors: BusErrors | None) -> dict[str, Any]:
    if errors is None:
        return {}
    return {
        "errors": dict(errors.causes),
        "received_twice": errors.received_twice,
        "missed_by_one": errors.missed_by_one,
    }


def summary_line(report: dict[str, Any]) -> str:
    """Return the same in one line, without what did not happen."""
    parts = [f"ran {report['duration_s']:.1f} s"]
    for name, channel in report["channels"].items():
        parts.append(f"{name} {channel['frames']} frames, load {channel['load']:.1%}")
        if channel["discarded"]:
            parts[-1] += f", {channel['discarded']} of clients that had gone discarded"
        if "errors" in channel:
            parts[-1] += f", {sum(channel['errors'].values())} errors"
        if channel["bus_offs"]:
            parts[-1] += f", {channel['bus_offs']}x bus-off"
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
    if clients["unprinted"]:
        parts.append(f"{clients['unprinted']} lines not printed")
    return "; ".join(parts)
