"""Checks of what this machine has for CAN and real time, and how to get what it lacks."""

import argparse
import json
import shutil
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...runtime.exit_status import BusError
from ...runtime.port.interface_choice import add_bus_arguments, choose_bus
from ...runtime.port.python_can import check_openable
from ...runtime.program.priority_and_memory_lock import real_time
from ...with_vcan.backend_choice import backends
from ...with_vcan.request import Request, missing_programs


class Finding(NamedTuple):
    """A property that was looked for, and the figure that shows it.

    ``ok``      None where nothing could show it
    ``advice``  what to do where it is wanted and is not there; empty for nothing
    """

    name: str
    ok: bool | None
    detail: str
    advice: str = ""


Findings = Mapping[str, Sequence[Finding]]
"""By the title of their section."""
_MARKS = {True: "ok", False: "NO", None: "-"}
DETECTION_TIMEOUT_S = 20.0
"""Time limit for all adapters together: a driver that hangs must not hang us."""
NO_ADAPTERS = ("virtual", "udp_multicast")
"""What python-can always detects."""
CHANNELS_SHOWN_MAX = 4
CAN_UTILS = ("candump", "cansend", "cangen", "canplayer")
REAL_TIME_PRIORITY = 50
"""The default of both programs."""

_NETWORK_INTERFACES = Path("/sys/class/net")
_ARPHRD_CAN = 280
_DETECT = """
import can, json
print(json.dumps(list(can.detect_available_configs()), default=str))
"""


def examine() -> Findings:
    """Check everything; takes seconds, most of them for the adapters."""
    return {
        "CAN on this machine": [_kernel_can(), *_interfaces(), _programs(), find_adapters()],
        "ways to a vcan0 (steer-by-wire with-vcan)": _ways_to_vcan(),
        "the programs without -i": [_choice()],
        "real time": _rights(),
    }


def _kernel_can() -> Finding:
    name = "CAN in the kernel"
    if sys.platform != "linux":
        return Finding(name, False, "only Linux has it", "use an adapter, or the emulated bus")
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        advice = "sudo modprobe can-raw (on Ubuntu first: sudo apt-get install "
        advice += "linux-modules-extra-$(uname -r)); steer-by-wire with-vcan; or the emulated bus"
        return Finding(name, False, f"socket(AF_CAN): {error.strerror}", advice)
    return Finding(name, True, "socket(AF_CAN) opens")


def _interfaces() -> list[Finding]:
    findings = []
    for folder in sorted(_NETWORK_INTERFACES.glob("*")):
        try:
            if int((folder / "type").read_text()) != _ARPHRD_CAN:
                continue
            is_up = bool(int((folder / "flags").read_text(), 16) & 1)
        except (OSError, ValueError):
            continue
        up = f"sudo ip link set {folder.name} up"
        name = f"interface {folder.name}"
        findings.append(Finding(name, is_up, "up" if is_up else "down", "" if is_up else up))
    if findings:
        return findings
    advice = "sudo modprobe vcan; sudo ip link add vcan0 type vcan; sudo ip link set vcan0 up"
    return [Finding("CAN interfaces", False, "none", advice)]


def _programs() -> Finding:
    missing = missing_programs(CAN_UTILS)
    if missing:
        advice = "sudo apt-get install can-utils"
        return Finding("can-utils", False, f"no {', '.join(missing)}", advice)
    return Finding("can-utils", True, str(shutil.which(CAN_UTILS[0])))


def find_adapters() -> Finding:
    """Ask python-can in a process of its own: drivers may hang, print or crash."""
    name = "adapters"
    try:
        asked = subprocess.run(
            [sys.executable, "-P", "-c", _DETECT],
            capture_output=True,
            text=True,
            timeout=DETECTION_TIMEOUT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
        found = json.loads(asked.stdout)
    except subprocess.TimeoutExpired:
        detail = f"python-can has not answered within {DETECTION_TIMEOUT_S:g} s"
        return Finding(name, False, detail, "name the interface with -i and -c")
    except ValueError:
        return Finding(name, False, "python-can has failed", f"{sys.executable} -c {_DETECT!r}")
    channels: dict[str, list[str]] = {}
    for config in found:
        channels.setdefault(config["interface"], []).append(str(config.get("channel", "")))
    shown = [_shortened(kind, on) for kind, on in channels.items() if kind not in NO_ADAPTERS]
    if any(kind not in (*NO_ADAPTERS, "serial") for kind in channels):
        return Finding(name, True, "; ".join(shown))
    detail = "; ".join(["python-can detects none", *shown])
    return Finding(name, False, detail, "the documentation of python-can names their drivers")


def _shortened(interface: str, channels: Sequence[str]) -> str:
    more = len(channels) - CHANNELS_SHOWN_MAX
    shown = ", ".join(channels[:CHANNELS_SHOWN_MAX])
    return f"{interface} {shown}" + (f" and {more} more" if more > 0 else "")


def _ways_to_vcan() -> list[Finding]:
    request = Request(("true",))
    ways = []
    for backend in backends():
        obstacle = backend.obstacle(request)
        ways.append(Finding(backend.name, not obstacle, obstacle or "possible"))
    if not ways:
        return [Finding("vcan0", False, "only on Linux", "use the emulated bus")]
    if not any(way.ok for way in ways):
        advice = "sudo apt-get install user-mode-linux kmod can-utils iproute2"
        ways[-1] = ways[-1]._replace(advice=advice)
    return ways


def _choice() -> Finding:
    parser = argparse.ArgumentParser()
    add_bus_arguments(parser)
    try:
        choice = choose_bus(parser.parse_args([]))
        check_openable(choice)
    except BusError as error:
        return Finding("bus", False, str(error), "give -i and -c, or mend the configuration")
    advice = "start steer-by-wire bus" if choice.interface == "emulated" else ""
    return Finding("bus", True, f"{choice.name} ({choice.reason})", advice)


def _rights() -> list[Finding]:
    """Request what the programs request; the memory lock stays until we end."""
    advice = {
        "real-time priority": "as root, or in /etc/security/limits.d: YOU - rtprio 99",
        "memory lock": "as root, or in /etc/security/limits.d: YOU - memlock unlimited",
    }
    with real_time(REAL_TIME_PRIORITY, lock_memory=True) as answers:
        granted = list(answers)
    return [Finding(*one, "" if one.got else advice.get(one.name, "")) for one in granted]


def as_json(found: Findings) -> dict[str, list[dict[str, Any]]]:
    """Return the findings for other programs."""
    return {title: [finding._asdict() for finding in its] for title, its in found.items()}


def as_text(found: Findings) -> str:
    """Return a line for each finding below the title of its section, and what to do below it."""
    lines = []
    for title, findings in found.items():
        lines += ["", title]
        width = max(len(finding.name) for finding in findings)
        for name, ok, detail, advice in findings:
            lines.append(f"  {_MARKS[ok]:2} {name:{width}}  {detail}")
            if advice:
                lines.append(f"     {'':{width}}  do: {advice}")
    return "\n".join(lines[1:])
