"""User Mode Linux: a kernel with CAN as an ordinary program, on the host's own files.

This module checks what it needs and starts it. Inside it runs ``uml_guest``; ``uml_streams``
connects the two.
"""

import json
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from . import xstate
from .guard import Launch, execute, start_guard
from .request import BackendError, Request, link_commands, missing_programs
from .supervision import TIMEOUT_STATUS, supervise
from .system_calls import FINIT_MODULE
from .uml_streams import Streams, has_terminal, raw_terminal

NAME = "uml"
PROGRAM = "linux.uml"
CPUS = Path("/proc/cpuinfo")
MODULE_FOLDERS = Path("/usr/lib/uml/modules")
MODULES = (
    "can", "can-raw", "can-bcm", "can-gw", "can-isotp", "can-j1939", "vcan", "vxcan", "slcan",
    "sch_netem", "sch_prio", "cls_basic", "em_canid",
)  # fmt: skip
"""Kernel modules to load, if they exist, with their dependencies."""
BOOT_S_MAX = 120.0
"""A boot takes two seconds, and ten on a busy machine."""


def obstacle(request: Request) -> str:
    """Why User Mode Linux is not available; empty when it is."""
    if platform.machine() not in FINIT_MODULE:
        return f"User Mode Linux is for x86, not {platform.machine()}"
    needed = {PROGRAM: "user-mode-linux", "ip": "iproute2"}
    if request.netem:
        needed["tc"] = "iproute2"
    if missing := missing_programs(list(needed)):
        packages = " ".join(dict.fromkeys(needed[name] for name in missing))
        return f"no program {', '.join(missing)} (apt-get install {packages})"
    if "User Mode Linux" in cpuinfo():
        return "this is one"
    if xstate.is_needed(cpuinfo()) and (why := xstate.obstacle()):
        return why
    try:
        _modules(request)
        _memory_folder(request)
    except BackendError as error:
        return str(error)
    return ""


def run(request: Request, timeout_s: float | None) -> int:
    """Run the command; returns its exit status. Raises BackendError when it does not boot."""
    # Where a boot without the library has failed before, the library is kept since.
    if xstate.is_needed(cpuinfo()) or xstate.is_kept():
        return _run(request, timeout_s, xstate.library())
    try:
        return _run(request, timeout_s)
    except BackendError as error:
        if xstate.SYMPTOM not in str(error):
            raise
        if missing := xstate.obstacle():
            raise BackendError(f"{error}; {missing}") from error
    return _run(request, timeout_s, xstate.library())


def _run(request: Request, timeout_s: float | None, preloaded: bytes = b"") -> int:
    """Boot once; ``preloaded`` is a library for the kernel alone."""
    folder, memory_folder = _make_folder(request), _memory_folder(request)
    environment = {**os.environ, "TMPDIR": str(memory_folder)}
    guest_in, to_guest = os.pipe()
    guest_stdin, to_stdin = os.pipe()
    from_guest, guest_out = os.pipe()
    theirs = [guest_in, guest_stdin, guest_out]
    if preloaded:
        theirs.append(_unnamed_file(preloaded, memory_folder))
        libraries = [f"/proc/self/fd/{theirs[-1]}", os.environ.get("LD_PRELOAD", "")]
        environment["LD_PRELOAD"] = ":".join(filter(None, libraries))
    kernel = _kernel_command(request, folder, guest_in, guest_out, guest_stdin)
    with tempfile.TemporaryFile() as said:

        def start() -> NoReturn:
            _become(kernel, environment, theirs, said.fileno())

        guard = start_guard(
            Launch(start, theirs, lambda: shutil.rmtree(folder, ignore_errors=True))
        )
        streams = Streams(guard, from_guest, to_guest, to_stdin)
        patience = threading.Timer(BOOT_S_MAX, streams.give_up, (BOOT_S_MAX,))
        patience.daemon = True
        patience.start()
        with raw_terminal():
            status = supervise(guard, timeout_s, streams.pass_on, streams.selector)
        patience.cancel()
        if status == TIMEOUT_STATUS:
            return status
        said.seek(0)
        return streams.finish(status, last_words(said.read()))


def _unnamed_file(content: bytes, folder: Path) -> int:
    """Return a descriptor of an unnamed file; ``folder`` must allow execution."""
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(content)
        file.flush()
        return os.dup(file.fileno())


def _become(
    kernel: Sequence[str], environment: dict[str, str], inherited: Sequence[int], said: int
) -> NoReturn:
    """Become the kernel, in a session of its own: Ctrl-C is for the command, and we pass it on.

    ``said``  takes what the kernel prints
    """
    os.setsid()
    # It has one processor; on one of the host's too, each switch from guest to kernel is cheaper.
    processors = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, [processors[os.getpid() % len(processors)]])
    for descriptor in inherited:
        os.set_inheritable(descriptor, True)
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(said, 1)
    os.dup2(said, 2)
    execute(kernel, environment)


def _kernel_command(
    request: Request, folder: Path, line_in: int, line_out: int, stdin: int
) -> list[str]:
    """Return how the kernel is started; what follows ``--`` is for its first process."""
    linker = os.environ.get("LD_LIBRARY_PATH")
    return [
        PROGRAM,
        f"mem={request.memory_mib}M",
        f"uml_dir={folder}",
        "rootfstype=hostfs",
        "rootflags=/",
        "rw",
        "quiet",
        "pty.legacy_count=0",  # it would make 512 devices that nothing opens: half of the boot
        "initcall_blacklist=raid6_select_algo",  # it would try for 0.4 s how to compute RAID 6
        "con=null",
        "con0=null,fd:1",
        f"ssl0=fd:{line_in},fd:{line_out}",
        f"ssl1=fd:{stdin},null",
        f"init={folder / 'python'}",
        *([f"LD_LIBRARY_PATH={linker}"] if linker else []),
        "--",
        "-IS",
        str(folder / "init.py"),
    ]


def _make_folder(request: Request) -> Path:
    """Write the guest's job into a private folder without blanks in its name."""
    place = tempfile.gettempdir()
    if any(character.isspace() or character in "\",'" for character in place):
        place = "/tmp"  # noqa: S108 the kernel's command line has blanks between its words
    folder = Path(tempfile.mkdtemp(prefix="with_vcan-", dir=place))
    root = Path(__file__).resolve().parents[1]  # of the package with_vcan, wherever it stands
    job = {
        "terminal": has_terminal(),
        "command": request.command,
        "environment": {**os.environ, "WITH_VCAN_BACKEND": NAME},
        "folder": os.getcwd(),
        "user": os.getuid(),
        "group": os.getgid(),
        "groups": os.getgroups(),
        "file_mask": _file_mask(),
        "limits": {
            number: resource.getrlimit(number)
            for name, number in vars(resource).items()
            if name.startswith("RLIMIT_")
        },
        "modules": _modules(request),
        "links": link_commands(request),
    }
    (folder / "job.json").write_text(json.dumps(job), encoding="ascii")
    (folder / "python").symlink_to(os.path.realpath(sys.executable))
    (folder / "init.py").write_text(
        f"import sys\nsys.path.append({str(root)!r})\nsys.dont_write_bytecode = True\n"
        f"from with_vcan.uml_guest import main\nmain({str(folder)!r})\n",
        encoding="utf-8",
    )
    return folder


def _file_mask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _modules(request: Request) -> list[tuple[str, str]]:
    """Return paths and parameters of the kernel modules, each after those it needs."""
    version = subprocess.run([PROGRAM, "--version"], capture_output=True, text=True, check=False)
    folder = MODULE_FOLDERS / version.stdout.strip()
    try:
        lines = (folder / "modules.dep").read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise BackendError(f"{folder} holds no kernel modules ({error.strerror})") from error
    needs: dict[str, list[str]] = {}
    by_name = {}
    for line in lines:
        path, _, others = line.partition(":")
        needs[path] = others.split()
        by_name[Path(path).name.partition(".ko")[0].replace("_", "-")] = path
    if "vcan" not in by_name:
        raise BackendError(f"{folder} has no module vcan")
    ordered: dict[str, str] = {}
    for name in MODULES:
        path = by_name.get(name.replace("_", "-"), "")
        for wanted in (*reversed(needs.get(path, [])), path):
            if wanted:
                echo = Path(wanted).name.startswith("vcan.") and request.netem
                ordered[str(folder / wanted)] = "echo=1" if echo else ""
    return list(ordered.items())


def _memory_folder(request: Request) -> Path:
    """Return a folder for the file that is the guest's memory: large enough, and executable.

    In a container /dev/shm is often neither.
    """
    tried = []
    for name in ("/dev/shm", os.environ.get("TMPDIR"), "/tmp", "/var/tmp"):  # noqa: S108
        if not name or not os.access(name, os.W_OK | os.X_OK):
            continue
        found = os.statvfs(name)
        free_mib = found.f_bavail * found.f_frsize // 2**20
        if found.f_flag & os.ST_NOEXEC:
            tried.append(f"{name} is mounted noexec")
        elif free_mib < request.memory_mib:
            tried.append(f"{name} has {free_mib} MiB left")
        else:
            return Path(name)
    raise BackendError(
        f"nowhere {request.memory_mib} MiB for its memory: {', '.join(tried)} "
        "(set TMPDIR or --memory)"
    )


def last_words(said: bytes) -> str:
    """Return the end of a kernel's output; of a panic, its cause without the call trace."""
    before, panic, trace = said.decode(errors="replace").partition("Kernel panic")
    lines = (before + panic + trace.partition("\n")[0]).splitlines()
    return "; ".join([line.strip() for line in lines if line.strip()][-2:])


def cpuinfo() -> str:
    """Return the content of /proc/cpuinfo."""
    return CPUS.read_text(encoding="utf-8", errors="replace")
