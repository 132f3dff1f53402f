"""The host's own interfaces, used as they are: nothing is created or changed."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from .guard import Launch, execute, start_guard
from .request import Request
from .supervision import supervise
from .system_calls import Signal

NAME = "host"

_NETWORK_INTERFACES = Path("/sys/class/net")
_ARPHRD_CAN = 280
_IFF_UP = 1


def obstacle(request: Request) -> str:
    """Why the command cannot run on the host's own interfaces; empty when it can."""
    if request.netem:
        return "the host's own interfaces are not given a latency"
    missing = [name for name in request.interfaces if not _is_up(name)]
    if missing:
        make = "; ".join(
            f"sudo ip link add {name} type vcan; sudo ip link set {name} mtu 72 up"
            for name in missing
        )
        return f"no CAN interface {', '.join(missing)} is up (sudo modprobe vcan; {make})"
    return ""


def run(request: Request, timeout_s: float | None) -> int:
    """Run the command; returns its exit status."""
    return run_as_child(timeout_s, lambda: _start(request))


def run_as_child(timeout_s: float | None, start: Callable[[], NoReturn]) -> int:
    """Run the process that ``start`` becomes on this machine, with our standard streams."""
    guard = start_guard(Launch(start))

    def pass_on(arrived: Signal) -> None:
        # The terminal sends its signals to all foreground processes, the command included.
        if not arrived.from_terminal:
            guard.send(arrived.number)

    return supervise(guard, timeout_s, pass_on)


def _start(request: Request) -> NoReturn:
    execute(request.command, {**os.environ, "WITH_VCAN_BACKEND": NAME})


def _is_up(name: str) -> bool:
    folder = _NETWORK_INTERFACES / name
    try:
        kind = int((folder / "type").read_text())
        flags = int((folder / "flags").read_text(), 16)
    except OSError:
        return False
    return kind == _ARPHRD_CAN and bool(flags & _IFF_UP)
