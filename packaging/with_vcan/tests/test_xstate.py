"""The library for User Mode Linux on processors with AMX: where it is needed, compiled and kept.

``test_uml_on_amx`` boots with it.
"""

import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from steer_by_wire.with_vcan import xstate
from steer_by_wire.with_vcan.request import BackendError

ROOT = Path(__file__).resolve().parents[3]
NOBODY = 65534
AVX512 = "model name\t: AMD EPYC\nflags\t\t: fpu xsave avx avx512f avx512_bf16\n"
AMX = "processor\t: 1\nflags\t\t: fpu xsave avx512f amx_bf16 avx512_fp16 amx_tile amx_int8\n"

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache directory of the user."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


@pytest.mark.parametrize(
    ("cpuinfo", "needed"),
    [
        (AMX, True),
        (AVX512, False),
        ("", False),
        ("model name\t: no amx_tiles\nflags\t: fpu amx_bf16\n", False),
    ],
)
def test_the_library_is_needed_on_processors_with_amx(cpuinfo: str, needed: bool) -> None:
    assert xstate.is_needed(cpuinfo) is needed


@needs_gcc
def test_the_library_is_compiled_once_and_kept(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = xstate.library()
    assert compiled.startswith(b"\x7fELF")
    assert [file.read_bytes() for file in cache.rglob("*.so")] == [compiled]
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("PATH", str(tmp_path / "nothing"))
        assert xstate.library() == compiled
    changed = tmp_path / "xstate.c"
    changed.write_bytes(xstate.SOURCE.read_bytes() + b"int more;\n")
    monkeypatch.setattr(xstate, "SOURCE", changed)
    assert xstate.library() != compiled
    assert len(list(cache.rglob("*.so"))) == 2


@needs_gcc
def test_several_that_compile_it_at_once_leave_it_whole(cache: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        compiled = list(pool.map(lambda _: xstate.library(), range(4)))
    assert [file.read_bytes() for file in (cache / "with_vcan").iterdir()] == [compiled[0]]
    assert len(set(compiled)) == 1


@needs_gcc
def test_where_nothing_can_be_kept_each_run_compiles_it(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.write_text("no directory")
    assert xstate.library().startswith(b"\x7fELF")
    assert cache.read_text() == "no directory"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/nowhere")
    assert xstate.kept_file().parent == Path("/nowhere/.cache/with_vcan")


@needs_gcc
@pytest.mark.skipif(os.geteuid() != 0, reason="only root may become another")
def test_a_user_who_may_not_look_where_it_is_kept_compiles_it(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    if not all(path.stat().st_mode & 0o5 for path in (ROOT, *ROOT.parents)):
        pytest.skip("this folder is not for others to read")
    script = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r});"
        "from steer_by_wire.with_vcan import xstate;"
        "print(xstate.obstacle(), xstate.library()[:4])"
    )
    done = subprocess.run(
        ["python3", "-B", "-c", script],
        env={**os.environ, "XDG_CACHE_HOME": str(closed)},
        cwd="/", user=NOBODY, group=NOBODY, extra_groups=[],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == " b'\\x7fELF'\n", done.stderr


@needs_gcc
def test_a_compiler_without_headers_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "broken.c"
    broken.write_text("#include <no_such_header.h>\n")
    monkeypatch.setattr(xstate, "SOURCE", broken)
    with pytest.raises(BackendError) as refusal:
        xstate.library()
    (line,) = str(refusal.value).splitlines()
    assert "no_such_header.h" in line
    assert "apt-get install gcc libc6-dev" in line
