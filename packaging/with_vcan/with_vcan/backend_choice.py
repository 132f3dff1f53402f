"""The choice of a way to vcan0: the host's own, a network namespace's, or User Mode Linux's."""

import platform
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import NamedTuple

from .request import BackendError, Request

BACKENDS = ("host", "namespace", "uml")
"""Modules of this folder."""
PACKAGES = "user-mode-linux kmod can-utils iproute2"
"""Of Debian and Ubuntu, for all backends but the host's own kernel."""


class Backend(NamedTuple):
    """One way to vcan0.

    ``obstacle``  why it cannot be used; empty if it can
    ``run``       runs a command, within a time [s]; returns its exit status
    """

    name: str
    obstacle: Callable[[Request], str]
    run: Callable[[Request, float | None], int]


def backends() -> Iterator[Backend]:
    """Yield the backends of this platform, best first; each is imported at its turn."""
    for name in BACKENDS if sys.platform == "linux" else ():
        module = import_module(f".{name}", __package__)
        yield Backend(name, module.obstacle, module.run)


def choose(wanted: str, request: Request) -> Backend:
    """Return the wanted backend, or the best; raises BackendError with every obstacle."""
    if sys.platform != "linux":
        raise BackendError("only Linux has SocketCAN: use the emulated bus (docs/emulated_bus.md)")
    obstacles = []
    for backend in backends():
        if wanted in ("auto", backend.name):
            obstacle = backend.obstacle(request)
            if not obstacle:
                return backend
            obstacles.append(f"{backend.name}: {obstacle}")
    advice = f"; {_advice()}" if wanted == "auto" else ""
    raise BackendError(
        f"no way to {', '.join(request.interfaces)}{advice} ({'; '.join(obstacles)})"
    )


def _advice() -> str:
    from .system_calls import FINIT_MODULE

    if platform.machine() in FINIT_MODULE:
        return f"on Debian and Ubuntu, apt-get install {PACKAGES}"
    return "on this processor it takes a kernel with vcan, the host's or that of a virtual machine"
