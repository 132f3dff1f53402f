"""The library that lets User Mode Linux run on processors with AMX; compiled where it is needed.

``xstate.c`` describes what it does. It is preloaded into ``linux.uml`` only.
"""

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

from .request import BackendError

SOURCE = Path(__file__).with_name("xstate.c")
COMPILER = "gcc"
FLAGS = ("-std=gnu11", "-O2", "-Wall", "-Wextra", "-shared", "-fPIC")
PACKAGES = "gcc libc6-dev"
SYMPTOM = "ptrace set fp regs failed"
"""The error with which User Mode Linux dies at its first process without the library."""


def is_needed(cpuinfo: str) -> bool:
    """Whether the processor is known to have more state than User Mode Linux has room for.

    ``cpuinfo``  content of /proc/cpuinfo
    """
    return "amx_tile" in cpuinfo.split()


def obstacle() -> str:
    """Why the library is not available; empty when it is."""
    if is_kept() or shutil.which(COMPILER):
        return ""
    return (
        f"on this processor User Mode Linux needs a small library, and there is no {COMPILER} to "
        f"compile it (apt-get install {PACKAGES})"
    )


def library() -> bytes:
    """Return the library, compiled unless an earlier run has kept it; raises BackendError."""
    kept = kept_file()
    with suppress(OSError):
        return kept.read_bytes()
    compiled = _compile()
    with suppress(OSError):  # where it cannot be kept, each run compiles it
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=kept.parent) as folder:
            written = Path(folder) / kept.name
            written.write_bytes(compiled)
            written.replace(kept)  # atomic: another run may be writing it too
    return compiled


def is_kept() -> bool:
    """Whether an earlier run has left the library."""
    return os.path.exists(kept_file())  # unlike Path.exists, also where it may not look


def kept_file() -> Path:
    """Return where the library is kept; the name depends on source, compiler and machine."""
    origin = (SOURCE.read_bytes(), COMPILER, FLAGS, platform.machine(), platform.libc_ver())
    key = hashlib.sha256(repr(origin).encode()).hexdigest()[:16]
    # A user without a home directory has "/~", where nothing can be kept.
    home = Path("/", os.path.expanduser("~"), ".cache")
    return home / os.environ.get("XDG_CACHE_HOME", "") / "with_vcan" / f"xstate-{key}.so"


def _compile() -> bytes:
    if missing := obstacle():
        raise BackendError(missing)
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder) / "xstate.so"
        command = [COMPILER, *FLAGS, "-o", str(compiled), str(SOURCE), "-ldl"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return compiled.read_bytes()
    complaints = done.stderr.splitlines() or [f"status {done.returncode}"]
    why = next((line for line in complaints if "error" in line), complaints[0])
    raise BackendError(
        f"{COMPILER} does not compile {SOURCE.name} (apt-get install {PACKAGES}): {why.strip()}"
    )
