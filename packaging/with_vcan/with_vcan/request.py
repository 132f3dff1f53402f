"""A request for a run with vcan0, and the error when it cannot be met."""

import os
import re
import shutil
from collections.abc import Sequence
from typing import NamedTuple

NAME_CHARACTERS_MAX = 15
"""Of a network interface: IFNAMSIZ without its final zero (linux/if.h)."""
INTERFACES_MAX = 64
FD_MTU = 72
"""With this MTU a CAN interface carries CAN FD frames too (linux/can.h, CANFD_MTU)."""
QUEUE_FRAMES = "100000"
"""Netem's queue by default: it holds every frame that is under way."""

MULTICAST = "224.0.0.0/4"
"""Of IP version 4; python-can's udp_multicast joins groups, which needs a route to them."""
SYSTEM_FOLDERS = "/usr/sbin:/sbin"
"""Where ip and tc are; not on every user's PATH."""

_NAME = re.compile(rf"[A-Za-z][A-Za-z0-9_.-]{{0,{NAME_CHARACTERS_MAX - 1}}}")


class Request(NamedTuple):
    """What to run.

    ``command``     program and arguments
    ``interfaces``  names of the CAN interfaces it finds
    ``netem``       name and parameters of the kernel's network emulator of those that have one
    ``memory_mib``  of a User Mode Linux [MiB]
    """

    command: tuple[str, ...]
    interfaces: tuple[str, ...] = ("vcan0",)
    netem: tuple[tuple[str, tuple[str, ...]], ...] = ()
    memory_mib: int = 1024


def program_path() -> str:
    """Return the PATH on which system programs are searched."""
    return f"{os.environ.get('PATH', os.defpath)}:{SYSTEM_FOLDERS}"


def missing_programs(names: Sequence[str]) -> list[str]:
    """Return which of the programs are missing on this machine."""
    return [name for name in names if shutil.which(name, path=program_path()) is None]


class BackendError(Exception):
    """A backend cannot run the command; the text is one line that names what is missing."""


def interface_names(text: str) -> tuple[str, ...]:
    """Read a number of interfaces or their names; raises ValueError.

    >>> interface_names("2")
    ('vcan0', 'vcan1')
    >>> interface_names("can0,vcan7")
    ('can0', 'vcan7')
    """
    if text.isascii() and text.isdecimal():
        if not 1 <= int(text) <= INTERFACES_MAX:
            raise ValueError(f"allowed is 1 to {INTERFACES_MAX} interfaces, not {text}")
        return tuple(f"vcan{index}" for index in range(int(text)))
    names = tuple(text.split(","))
    for name in names:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is no name of a network interface")
    if len(set(names)) < len(names):
        raise ValueError(f"{text!r} names an interface twice")
    return names


def netem_of(
    texts: Sequence[str], interfaces: Sequence[str]
) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Read ``PARAMETERS`` of all interfaces or ``NAME:PARAMETERS`` of one; raises ValueError.

    >>> netem_of(["vcan1:delay 40ms"], ["vcan0", "vcan1"])
    (('vcan1', ('delay', '40ms')),)
    """
    found: dict[str, tuple[str, ...]] = {}
    for text in texts:
        name, colon, parameters = text.rpartition(":")
        if colon and name not in interfaces:
            raise ValueError(f"there is no interface {name!r} to give a latency")
        if not parameters.split():
            raise ValueError(f'{text!r} holds no parameters, as "delay 40ms 10ms"')
        for interface in [name] if colon else interfaces:
            found[interface] = tuple(parameters.split())
    return tuple(found.items())


def link_commands(request: Request) -> list[list[str]]:
    """Return the commands that make the request's interfaces in a private network."""
    commands = [["ip", "link", "set", "lo", "up"], ["ip", "route", "add", MULTICAST, "dev", "lo"]]
    for name in request.interfaces:
        commands += [
            ["ip", "link", "add", "dev", name, "type", "vcan"],
            ["ip", "link", "set", name, "mtu", str(FD_MTU), "up"],
        ]
    for name, words in request.netem:
        limit = () if "limit" in words else ("limit", QUEUE_FRAMES)
        commands.append(["tc", "qdisc", "add", "dev", name, "root", "netem", *limit, *words])
    return commands
