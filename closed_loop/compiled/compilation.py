"""Compilation of the run's functions: without the interpreter's lock, and cached on disk.

numba takes a cached function for valid while the function's own file is unchanged; it misses a
change in one of the step functions that it calls. So everything compiled is kept in a folder named
after the content of all files that any of it may come from. Every copy of them shares it: what one
clone or environment has compiled, the next one takes from disk.

Processes that need the same function at the same time compile it once: the first one compiles it,
and the others wait until it is on disk.
"""

import hashlib
import io
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import IO, Any

import numba
from numba.core.caching import IndexDataCacheFile, UserProvidedCacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.np import linalg

from ...runtime.program.priority_and_memory_lock import no_collections
from .inlined_functions import CallerCompiler

if sys.platform != "win32":
    import fcntl

_config: Any = numba.config
_linalg: Any = linalg
_SOURCES = ("controller", "plant_emulator", "runtime", "dbc", "hand_wheel", "closed_loop/compiled")
_SUFFIXES = (".py", ".dbc")
_VERSIONS_KEPT = 4
"""Versions of the sources whose code stays on disk: several megabytes each."""
_UNUSED_S = 3600.0
"""Code of other versions stays for this long: a process that started with it may still compile."""
_PACKAGE = Path(__file__).resolve().parents[2]
_OPTIONS = {"nogil": True, "no_cfunc_wrapper": True, "pipeline_class": CallerCompiler}
"""Without the entry for callers in C, which is slow to compile."""
_DIGEST_LENGTH = hashlib.sha256().digest_size
_UNCOUNTED, _COUNTED = {"_nrt": False}, {"_nrt": True}
"""Whether arrays have reference counts; without them nothing can make an array."""


class CacheLocator(UserProvidedCacheLocator):
    """Finds a function on disk by the name of its file, whatever folder that is in.

    Of two files of one name the content tells which is meant: numba compares it.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the folder for the functions of a file."""
        return Path(py_file).parent.name


_CacheFiles: Any = IndexDataCacheFile


class DigestedFiles(_CacheFiles):  # type: ignore[misc]
    """Files of compiled code that end with their digest; a damaged one would crash the process.

    It is removed, and what was in it is compiled again. numba's loader ignores what follows a
    pickle.
    """

    def save(self, key: Any, data: Any) -> None:
        """Keep compiled code, unless the disk is full."""
        with suppress(OSError):
            super().save(key, data)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[IO[bytes]]:
        with super()._open_for_write(filepath) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())

    def _load_index(self) -> Any:
        _remove_damaged(Path(self._index_path))
        return super()._load_index()

    def _load_data(self, name: str) -> Any:
        _remove_damaged(Path(self._data_path(name)))
        return super()._load_data(name)


def _remove_damaged(file: Path) -> None:
    if file.exists():
        content = file.read_bytes()
        if hashlib.sha256(content[:-_DIGEST_LENGTH]).digest() != content[-_DIGEST_LENGTH:]:
            file.unlink(missing_ok=True)


_LOCATOR = f"{__name__}.{CacheLocator.__name__}"


def compiled(function: Any) -> Any:
    """Compile a function at its first call, or take it from disk.

    Without a writable folder every process compiles it again. Compiled code keeps the order of
    operations: no fast-math, no fused multiply-add.
    """
    return _compiled(function, _OPTIONS)


def compiled_unchecked(function: Any) -> Any:
    """Compile a function whose divisors are never zero, without a test of each."""
    return _compiled(function, {**_OPTIONS, "error_model": "numpy", **_UNCOUNTED})


def compiled_inside(function: Any) -> Any:
    """Compile a function that only compiled functions call; it has no entry from Python."""
    return _compiled(function, {**_OPTIONS, "no_cpython_wrapper": True, **_UNCOUNTED})


def compiled_for_process(made: Any) -> Any:
    """Compile a result of the above once more, for this process alone.

    For steps from files whose content is not part of the folder's name. They may make arrays.
    """
    options = {**made.targetoptions, **_COUNTED, "pipeline_class": CallerCompiler}
    again: Any = numba.jit(**options)(made.py_func)
    return again


@cache
def _load_numba() -> None:
    """Load what numba knows of arrays without scipy, which takes longer than all of numba.

    A step that multiplies matrices loads it when it is compiled. Loops of vectors take two at once:
    a car's step is so long that a processor would not find the next one to fill its waits with.
    LLVM then does so for all that this process compiles.
    """
    import_module("llvmlite.binding").set_option("", "-force-vector-interleave=2")
    loads_scipy, _linalg.ensure_blas = _linalg.ensure_blas, lambda: None
    import_module("numba.np.arraymath")
    _linalg.ensure_blas = loads_scipy


def _compiled(function: Any, options: Mapping[str, Any]) -> Any:
    _load_numba()
    folder = _cache_folder()
    # Read by the next line.
    _config.CACHE_DIR, _config.CACHE_LOCATOR_CLASSES = str(folder or ""), _LOCATOR if folder else ""
    made: Any = numba.jit(cache=folder is not None, **options)(function)
    _config.CACHE_LOCATOR_CLASSES = ""
    if folder is not None:
        cache = made._cache
        old = cache._cache_file
        base = old._index_name.removesuffix(".nbi")
        cache._cache_file = DigestedFiles(old._cache_path, base, old._source_stamp)
    if folder is not None and sys.platform != "win32":
        name = f"{function.__module__}.{function.__qualname__}"
        made.compile = _in_one_process(made.compile, name, folder)
    return made


def _in_one_process(compile_one: Callable[..., Any], name: str, folder: Path) -> Callable[..., Any]:
    """Let ``compile_one`` wait while another process compiles the same for the same arguments."""

    def compile_or_wait(arguments: Any) -> Any:
        key = hashlib.sha256(f"{name} {arguments}".encode()).hexdigest()[:16]
        try:
            folder.mkdir(parents=True, exist_ok=True)  # newer sources may have had it removed
            lock_file = (folder / f"{key}.lock").open("w")
        except OSError:
            return compile_one(arguments)
        # Lock the threads of this process first: one that waits for the file's lock could block the
        # one that has to release it.
        with global_compiler_lock, lock_file as lock, no_collections():
            fcntl.flock(lock, fcntl.LOCK_EX)
            return compile_one(arguments)

    return compile_or_wait


def sources() -> list[Path]:
    """Return the files that compiled code may come from; their content names its folder."""
    folders = ((_PACKAGE / name).resolve() for name in _SOURCES)
    return [
        path
        for folder in folders
        for path in sorted(folder.rglob("*.*"))
        if path.suffix in _SUFFIXES
    ]


@cache
def _cache_folder() -> Path | None:
    """Return the folder for code compiled from the present sources."""
    made_by = f"{sys.version} {numba.__version__} {_config.OPT}"
    digest = hashlib.sha256(made_by.encode())
    for source in sources():
        digest.update(source.read_bytes())
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "steer-by-wire-emulator" / digest.hexdigest()[:16]
    try:
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        if is_new:
            _forget_unused(folder.parent)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _forget_unused(base: Path) -> None:
    """Remove code of versions that no process has begun with lately, except the newest few."""
    used_s = {}
    for folder in base.iterdir():
        with suppress(FileNotFoundError):  # another process removes it too
            used_s[folder] = folder.stat().st_mtime
    newest = sorted(used_s, key=used_s.__getitem__, reverse=True)
    for folder in newest[_VERSIONS_KEPT:]:
        if used_s[folder] < used_s[newest[0]] - _UNUSED_S:
            shutil.rmtree(folder, ignore_errors=True)
