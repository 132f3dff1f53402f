"""User Mode Linux on processors with AMX, whose floating point state is larger than its buffer.

``amx_host.c``, preloaded into the real ``linux.uml``, makes this host look like such a processor.
``traced_state.c`` queries what the kernel of this machine itself answers to a tracer.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from steer_by_wire.with_vcan import uml, xstate
from steer_by_wire.with_vcan.backend_choice import choose
from steer_by_wire.with_vcan.request import SYSTEM_FOLDERS, BackendError, Request
from tests.support.programs.running_program import PATIENCE_S

ROOT = Path(__file__).resolve().parents[3]
SOURCES = Path(__file__).parent
LINUX_UML = shutil.which("linux.uml")
AVX512 = "flags\t\t: fpu xsave avx avx512f avx512_bf16\n"
AMX = "flags\t\t: fpu xsave avx avx512f avx512_fp16 amx_tile amx_int8\n"
DEATH = "userspace - ptrace set fp regs failed, errno = 14"

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


def uml_obstacle() -> str:
    try:
        choose("uml", Request(("true",)))
    except BackendError as error:
        return str(error)
    return ""


UML_OBSTACLE = uml_obstacle()
needs_uml = pytest.mark.skipif(bool(UML_OBSTACLE), reason=UML_OBSTACLE)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache directory of the user."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


def compile_c(source: Path, program: Path, *flags: str) -> None:
    command = ["gcc", "-O2", "-Wall", "-Wextra", "-Werror", *flags, "-o", str(program)]
    subprocess.run([*command, str(source)], check=True)


def make_machine(folder: Path, boot: str) -> None:
    """Make a machine whose ``linux.uml`` runs the shell script instead of booting."""
    program = folder / "bin" / "linux.uml"
    program.parent.mkdir()
    version = f'[ "$1" != --version ] || exec {LINUX_UML} "$@"'
    program.write_text(f"#!/bin/sh\n{version}\necho boot >>{folder}/boots\n{boot}\n")
    program.chmod(0o755)


@pytest.fixture
def amx_host(tmp_path: Path) -> Path:
    """A machine whose ``linux.uml`` runs as if on a host with AMX."""
    layer = tmp_path / "amx_host.so"
    compile_c(SOURCES / "amx_host.c", layer, "-shared", "-fPIC")
    make_machine(tmp_path, f'LD_PRELOAD="$LD_PRELOAD:{layer}" exec {LINUX_UML} "$@"')
    return tmp_path


def boots(machine: Path) -> int:
    return len((machine / "boots").read_text().splitlines())


WITH_CPUINFO = """
import sys
from pathlib import Path
from steer_by_wire.with_vcan import uml
from steer_by_wire.with_vcan.__main__ import main
uml.CPUS = Path(sys.argv[1])
sys.exit(main(["--backend", "uml", *sys.argv[2:]]))
"""


def with_vcan(
    machine: Path, *command: str, cpuinfo: str = AVX512, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run the command in a User Mode Linux on such a machine; ``PATH`` is beside its programs."""
    (machine / "cpuinfo").write_text(cpuinfo)
    path = f"{machine / 'bin'}:{variables.pop('PATH', os.environ['PATH'])}"
    return subprocess.run(
        [sys.executable, "-c", WITH_CPUINFO, str(machine / "cpuinfo"), *command],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
        cwd=ROOT,
        env={**os.environ, **variables, "PATH": path},
        stdin=subprocess.DEVNULL,
    )


@needs_gcc
@pytest.mark.skipif("avx" not in uml.cpuinfo().split(), reason="needs a processor with AVX")
def test_the_host_sets_only_the_whole_state_and_the_library_makes_a_part_whole(
    tmp_path: Path,
) -> None:
    """What this machine's own kernel answers; all other requests are as without the library."""
    program, library = tmp_path / "traced_state", tmp_path / "xstate.so"
    compile_c(SOURCES / "traced_state.c", program)
    library.write_bytes(xstate.library())

    def said(**variables: str) -> list[str]:
        done = subprocess.run([program], env=variables, capture_output=True, text=True, check=True)
        assert not done.stderr
        return done.stdout.splitlines()

    without, with_it = said(), said(LD_PRELOAD=str(library))
    assert without[1:3] == ["set -1 errno 14", "set as wanted 0, the same as before 1"]
    assert with_it[1:3] == ["set 0 errno 0", "set as wanted 1, the same as before 0"]
    assert with_it[:1] + with_it[3:] == without[:1] + without[3:]
    assert without[3:] == [
        "whole set 0, as wanted 1",
        "data 42 errno 0",
        "data of -1 -1 errno 0",
        "text -1 errno 0",
        "nowhere -1 errno 5",
        "orig_rax -1 errno 0",
        "no register -1 errno 5",
        "registers 0, rip the same 1",
    ]


@needs_gcc
@needs_uml
def test_one_that_dies_of_its_state_is_booted_again_with_the_library(
    amx_host: Path, cache: Path
) -> None:
    """Also where the processor is not known for it; the program alone gets the library."""
    shows = "ls -d /sys/class/net/vcan0; echo $LD_PRELOAD; cat /proc/1/environ"
    done = with_vcan(amx_host, "sh", "-c", shows, LD_PRELOAD="libm.so.6")
    assert done.returncode == 0, done.stderr
    assert boots(amx_host) == 2
    vcan, preloaded, environment = done.stdout.splitlines()
    assert (vcan, preloaded) == ("/sys/class/net/vcan0", "libm.so.6")
    assert "LD_PRELOAD" not in environment
    assert len(list((cache / "with_vcan").iterdir())) == 1
    assert with_vcan(amx_host, "true").returncode == 0
    assert boots(amx_host) == 3, "what the first run has found out is not forgotten"


@needs_gcc
@needs_uml
def test_on_a_processor_with_amx_the_kept_library_is_there_from_the_first_boot(
    amx_host: Path,
) -> None:
    xstate.library()
    done = with_vcan(amx_host, "/bin/sh", "-c", "exit 7", cpuinfo=AMX, PATH=SYSTEM_FOLDERS)
    assert done.returncode == 7, done.stderr
    assert boots(amx_host) == 1


@needs_gcc
@needs_uml
def test_where_it_cannot_be_compiled_one_line_says_what_to_install(amx_host: Path) -> None:
    unknown = with_vcan(amx_host, "/bin/true", PATH=SYSTEM_FOLDERS)
    known = with_vcan(amx_host, "/bin/true", cpuinfo=AMX, PATH=SYSTEM_FOLDERS)
    for done in (unknown, known):
        assert done.returncode == 3
        (line,) = done.stderr.splitlines()
        assert "no gcc to compile it (apt-get install gcc libc6-dev)" in line
    assert f"(status 134); its last words: {DEATH}; Kernel panic" in unknown.stderr
    assert boots(amx_host) == 1


@needs_uml
@pytest.mark.parametrize(
    ("boot", "words"),
    [
        ("echo no memory >&2; exit 5", "has not booted (status 5); its last words: no memory"),
        ("kill -ABRT $$", "has not booted (status 134); its last words: none"),
    ],
)
def test_one_that_dies_at_boot_is_reported_with_its_last_words(
    boot: str, words: str, tmp_path: Path
) -> None:
    make_machine(tmp_path, boot)
    done = with_vcan(tmp_path, "true")
    assert done.returncode == 3
    (line,) = done.stderr.splitlines()
    assert line.endswith(words)
    assert boots(tmp_path) == 1


def test_the_last_words_of_a_panic_are_its_cause_and_not_the_trace() -> None:
    panic = "Kernel panic - not syncing: Attempted to kill init! exitcode=0x0000000b"
    said = f"noise\n{DEATH}\n{panic}\nCPU: 0 PID: 1\nCall Trace:\n [<606944ba>] ? _printk+0x0\n\n"
    assert uml.last_words(said.encode()) == f"{DEATH}; {panic}"
    assert xstate.SYMPTOM in DEATH
    assert uml.last_words(b"") == ""
    assert uml.last_words(b"\xff\n \n") == "\ufffd"
