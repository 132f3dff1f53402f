"""How the batch functions are compiled: without the interpreter's lock, and kept on disk.

What numba keeps on disk it takes for valid while the file of the compiled function is unchanged; a
change in one of the step functions it calls goes unnoticed. So everything compiled is kept in a
folder named after the content of all the files that any of it may come from.

Processes that need the same function at the same time compile it once: the first does, and the
others wait for it to be on disk.
"""

import hashlib
import os
import shutil
import sys
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from typing import Any, Literal

# The first level of LLVM's optimisation and not the third, numba's own: it compiles sooner, and
# what it makes of these loops, of many small functions on tuples of floats, is no slower; the
# predictor's takes half the time. To be said before numba is imported.
os.environ.setdefault("NUMBA_OPT", "1")

import numba
from numba.core.compiler_lock import global_compiler_lock

if sys.platform != "win32":
    import fcntl

_SOURCES = ("controller", "plant_emulator", "runtime", "dbc", "tools/batch")
_FASTMATH = frozenset(("reassoc", "nsz", "arcp", "contract", "afn"))
"""Operations may change order and fuse. NaN and infinity stay what they are: a command that is not
finite ends a run, and a limit that is infinite is none."""
_VERSIONS_KEPT = 4
"""Versions of the sources whose code stays on disk: several megabytes each."""
_ROOT = Path(__file__).resolve().parents[2]
_njit: Any = numba.njit
"""Its type does not know of leaving out the entries for callers, which take long to compile."""


def compiled(function: Any) -> Any:
    """Compile a function at its first call, or take it from disk.

    Without a folder that can be written it is compiled anew in every process. Compiled code keeps
    to the order of its operations: no fast-math, no fused multiply-add.
    """
    return _compiled(function, "never")


def compiled_fastmath(function: Any) -> Any:
    """Compile what ``compiled`` has returned once more, with the steps it calls: operations may
    change order and fuse, so results differ in their last digits, and from processor to processor.
    """
    return _compiled(function.py_func, "never", _FASTMATH)


def compiled_anew(function: Any, *, fastmath: bool = False) -> Any:
    """Compile what ``compiled`` has returned once more, for this process alone.

    For steps from files that the folder is not named after.
    """
    return _njit(nogil=True, no_cfunc_wrapper=True, fastmath=set(_FASTMATH) if fastmath else False)(
        function.py_func
    )


def compiled_inside(function: Any) -> Any:
    """Compile a function for compiled ones that call it, without an entry from Python either."""
    return _njit(nogil=True, no_cfunc_wrapper=True, no_cpython_wrapper=True)(function)


def compiled_inline(function: Any) -> Any:
    """Compile a function as a part of those that call it: for the innermost of a loop."""
    return _compiled(function, "always")


def _compiled(
    function: Any, inline: Literal["always", "never"], fastmath: Collection[str] = ()
) -> Any:
    folder = _cache_folder()
    if folder is not None:
        # Read when decorating. On disk both kinds would be taken for the same function.
        own = folder / "fastmath" if fastmath else folder
        numba.config.CACHE_DIR = str(own)  # type: ignore[attr-defined]
    made = _njit(
        nogil=True,
        cache=folder is not None,
        inline=inline,
        fastmath=set(fastmath) or False,
        no_cfunc_wrapper=True,
    )(function)
    if folder is not None and sys.platform != "win32":
        name = f"{function.__module__}.{function.__qualname__}"
        made.compile = _in_one_process(made.compile, name, own)
    return made


def _in_one_process(compile_one: Callable[..., Any], name: str, folder: Path) -> Callable[..., Any]:
    """Let ``compile_one`` wait while another process compiles the same for the same arguments."""

    def compile_or_wait(arguments: Any) -> Any:
        key = hashlib.sha256(f"{name} {arguments}".encode()).hexdigest()[:16]
        # The threads of a process first: who waits for a file would hold up who is to release it.
        with global_compiler_lock, (folder / f"{key}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return compile_one(arguments)

    return compile_or_wait


def sources() -> list[Path]:
    """Return the files that compiled code may come from, which its folder is named after."""
    return sorted(path for name in _SOURCES for path in (_ROOT / name).rglob("*.py"))


@cache
def _cache_folder() -> Path | None:
    """Return the folder for code compiled from the sources as they are now."""
    made_by = f"{sys.version} {numba.__version__} {os.environ['NUMBA_OPT']}"
    digest = hashlib.sha256(made_by.encode())
    for source in sources():
        digest.update(source.read_bytes())
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "steer-by-wire-emulator" / digest.hexdigest()[:16]
    try:
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        if is_new:
            _forget_oldest(folder.parent)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _forget_oldest(base: Path) -> None:
    """Remove what was compiled from older sources, but for the newest few."""
    folders = sorted(base.iterdir(), key=lambda folder: folder.stat().st_mtime, reverse=True)
    for folder in folders[_VERSIONS_KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)
