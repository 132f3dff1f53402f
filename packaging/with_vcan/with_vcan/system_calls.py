"""The few system calls of Linux that Python's standard library lacks.

Each raises OSError when it fails.
"""

import ctypes
import os
import platform
import signal
import struct
from collections.abc import Iterable
from typing import NamedTuple

CLONE_NEWNS, CLONE_NEWUSER, CLONE_NEWNET = 0x00020000, 0x10000000, 0x40000000  # linux/sched.h
MS_NOSUID, MS_NODEV, MS_NOEXEC = 2, 4, 8  # linux/mount.h
MS_REC, MS_PRIVATE = 0x4000, 0x40000
SI_KERNEL = 0x80
"""Origin of a signal: the kernel, as for Ctrl-C at a terminal (asm-generic/siginfo.h)."""
FINIT_MODULE = {"x86_64": 313, "i686": 350}
"""Number of the system call by machine (asm/unistd.h); User Mode Linux is for x86 only."""

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36  # linux/prctl.h
_RB_POWER_OFF = 0x4321FEDC  # linux/reboot.h
_SIGNAL_SET_BYTES = 128
_SIGNAL_INFO = struct.Struct("=Iii116x")
"""Begin and length of struct signalfd_siginfo: number, errno, origin."""


class Signal(NamedTuple):
    """One signal that has come, and whether the kernel sent it itself."""

    number: int
    from_terminal: bool


def _libc(function: str, *arguments: object) -> int:
    result = int(getattr(ctypes.CDLL(None, use_errno=True), function)(*arguments))
    if result == -1:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return result


def mount(kind: str, target: str, flags: int = 0, options: str = "") -> None:
    """Mount a file system without a device."""
    words = (kind.encode(), os.fsencode(target), kind.encode())
    _libc("mount", *words, ctypes.c_ulong(flags), options.encode())


def make_mounts_private() -> None:
    """Keep later mounts invisible outside this mount namespace."""
    _libc("mount", b"none", b"/", None, ctypes.c_ulong(MS_REC | MS_PRIVATE), None)


def unshare(flags: int) -> None:
    """Leave namespaces for new ones."""
    _libc("unshare", ctypes.c_int(flags))


def adopt_orphans() -> None:
    """Become the parent of descendants whose own parent has ended."""
    _libc("prctl", _PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def die_with_parent() -> None:
    """Have this process killed when its parent thread ends."""
    _libc("prctl", _PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)


def insert_module(path: str, parameters: str) -> None:
    """Load a module into the kernel; a module that is already loaded is no error."""
    with open(path, "rb") as file:
        number = FINIT_MODULE[platform.machine()]
        try:
            _libc("syscall", ctypes.c_long(number), file.fileno(), parameters.encode(), 0)
        except FileExistsError:
            return


def power_off() -> None:
    """Switch the machine off at once."""
    _libc("reboot", ctypes.c_int(_RB_POWER_OFF))


def signal_descriptor(numbers: Iterable[int]) -> int:
    """Return a descriptor from which ``read_signal`` reads the (blocked) signals."""
    members = bytearray(_SIGNAL_SET_BYTES)
    for number in numbers:
        members[(number - 1) // 8] |= 1 << (number - 1) % 8
    return _libc("signalfd", -1, bytes(members), os.O_CLOEXEC)


def read_signal(descriptor: int) -> Signal:
    """Return the oldest pending signal; waits for one if there is none."""
    number, _, origin = _SIGNAL_INFO.unpack(os.read(descriptor, _SIGNAL_INFO.size))
    return Signal(number, origin == SI_KERNEL)
