"""A private network namespace: its interfaces are visible inside only, and end with it.

Root makes one directly. An ordinary user makes a user namespace around it, is root inside while the
interfaces are made, and then becomes itself again by a second user namespace.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

from .guard import execute, exit_status
from .host import run_as_child
from .links import LinkError, make_links
from .request import BackendError, Request, link_commands, missing_programs, program_path
from .system_calls import (
    CLONE_NEWNET,
    CLONE_NEWNS,
    CLONE_NEWUSER,
    MS_NODEV,
    MS_NOEXEC,
    MS_NOSUID,
    make_mounts_private,
    mount,
    unshare,
)

NAME = "namespace"
FAILED_STATUS = 3

_ECHO = Path("/sys/module/vcan/parameters/echo")


def obstacle(request: Request) -> str:
    """Why no such namespace can be made; empty when it can. Makes one to find out."""
    programs = ["ip", "tc"] if request.netem else ["ip"]
    if missing := missing_programs(programs):
        return f"no program {', '.join(missing)} (apt-get install iproute2)"
    read_end, write_end = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            _enter(request)
            os._exit(0)
        except BaseException as error:  # no exception may leave a forked process
            os.write(write_end, str(error).encode()[:2000])
        os._exit(1)
    os.close(write_end)
    with open(read_end, "rb") as answer:
        text = answer.read().decode(errors="replace")
    _, status = os.waitpid(pid, 0)
    return " ".join(text.split()) or ("" if exit_status(status) == 0 else "it cannot be made")


def run(request: Request, timeout_s: float | None) -> int:
    """Run the command; returns its exit status."""
    return run_as_child(timeout_s, lambda: _start(request))


def _start(request: Request) -> NoReturn:
    try:
        _enter(request)
    except BackendError as error:
        print(f"with-vcan: error: {error}", file=sys.stderr, flush=True)
        os._exit(FAILED_STATUS)
    execute(request.command, {**os.environ, "WITH_VCAN_BACKEND": NAME})


def _enter(request: Request) -> None:
    """Move this process into a new namespace with the request's interfaces."""
    user, group = os.geteuid(), os.getegid()
    if user == 0:
        _load_vcan(request)
    try:
        if user != 0:
            unshare(CLONE_NEWUSER)
            _map(f"0 {user} 1", f"0 {group} 1")
        unshare(CLONE_NEWNET | CLONE_NEWNS)
        make_mounts_private()
        # The network namespace that /sys/class/net shows is fixed when it is mounted.
        mount("sysfs", "/sys", MS_NOSUID | MS_NODEV | MS_NOEXEC)
    except OSError as error:
        raise BackendError(f"no private network namespace: {error.strerror}") from error
    try:
        make_links(link_commands(request), program_path())
    except LinkError as error:
        raise BackendError(_explain(error)) from error
    if request.netem and _ECHO.read_text().strip() not in "Y1":
        raise BackendError(
            "the module vcan is loaded without echo=1, so that frames pass the latency by "
            "(sudo modprobe -r vcan; sudo modprobe vcan echo=1)"
        )
    if user != 0:
        unshare(CLONE_NEWUSER)
        _map(f"{user} 0 1", f"{group} 0 1")


def _map(users: str, groups: str) -> None:
    process = Path("/proc/self")
    (process / "setgroups").write_text("deny")
    (process / "uid_map").write_text(users)
    (process / "gid_map").write_text(groups)


def _load_vcan(request: Request) -> None:
    """Load vcan with the echo that netem needs; if that fails, the next command reports it."""
    if request.netem and not _ECHO.exists() and not missing_programs(["modprobe"]):
        command = ["modprobe", "vcan", "echo=1"]
        environment = {**os.environ, "PATH": program_path()}
        subprocess.run(command, capture_output=True, check=False, env=environment)


def _explain(error: LinkError) -> str:
    unknown = "Unknown device type" in error.complaint or "not supported" in error.complaint
    if "vcan" in error.command and unknown:
        return (
            "this kernel has no vcan (sudo modprobe vcan; on Ubuntu first: sudo apt-get install "
            "linux-modules-extra-$(uname -r))"
        )
    return str(error)
