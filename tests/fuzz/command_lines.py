"""Random command lines to every program, up to the start of its work.

    A program returns a status, or ends by argparse with 0 or 2; no exception escapes, and no
    traceback is printed. Where it rejects the arguments, standard error contains the reason.

What a program opens, starts or computes for long is replaced by a stop, so that an input takes
milliseconds and leaves nothing behind. It runs in a folder of its own, which contains the files
that the arguments name.
"""

import importlib
import io
import os
import re
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, chdir, contextmanager, redirect_stderr, redirect_stdout
from functools import lru_cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import NamedTuple, NoReturn
from unittest.mock import patch

from tests.fuzz.log_targets import damaged, faultless_log
from tests.fuzz.traffic import text_of

WORDS_MAX = 8
_STOPS: Mapping[str, tuple[str, ...]] = {
    "controller.command_line.program": (
        "runtime.program.run_node.open_port", ".check_figures", ".check_text", ".found_in",
    ),
    "plant_emulator.command_line.program": ("runtime.program.run_node.open_port",),
    "hand_wheel.program": ("runtime.program.run_node.open_port",),
    "tools.bus.program": (".listening",),
    "tools.analyze.__main__": ("tools.analyze.pictures.draw_pictures",),
    "tools.run.__main__": (
        "closed_loop.pair.virtual_pair.VirtualPair.run",
    ),
    "tools.demo.__main__": (".open_channels",),
    "tools.design.__main__": ("tools.design.program.worker_pool",),
    "tools.doctor.__main__": ("tools.doctor.checks.examine",),
    "tools.monitor.__main__": (".open_port",),
    "tools.paper.__main__": (".reproduce_all",),
    "tools.study.__main__": ("closed_loop.studies.result_files.Store.open",),
    "with_vcan.__main__": (".choose",),
}  # fmt: skip
"""Every program that takes arguments, and where it is stopped; a dot stands for its own module."""
PROGRAMS: Mapping[str, tuple[str, ...]] = {
    f"steer_by_wire.{program}": tuple(
        f"steer_by_wire.{program * place.startswith('.')}{place}" for place in places
    )
    for program, places in _STOPS.items()
}
FILES = (
    "run.log", "run.blf", "noise.bin", "noise.log", "empty.toml", "controller.toml", "plant.toml",
    "study.toml", "vehicle.toml", "spec.toml", "noise.toml", "folder",
)  # fmt: skip
_WORDS = (
    "", "-", "--", "-1", "0", "1", "7", "nan", "inf", "1e999", "1e-9", "9" * 30, "9" * 5000,
    "missing/x.json", "out.json", "out.log", "out", "folder/x.csv", "/dev/null", "/dev/full",
    "practical_pd", "paper_nominal", "paper_pd", "virtual", "emulated", "socketcan", "vcan0",
    "127.0.0.1:99999999", "localhost:" + "9" * 5000, "law=pd", "seed=3", "pd.x.y=1",
    "latency.downlink.mean_s=0.1", "path.kind=waypoints", "path.file=\"noise.bin\"", "rate_hz=1e9",
    "\udcff", "\x1b[31m", "ÿ☃\U0001f600", "a b", "=", "x=", "=x", "figure", "6", "2", "auto",
    "host", "true", "controller", "delay 10ms", "vcan0,vcan0", "out\udcff.json", "out\n.log",
    "babble", "noise,seed=1", "spoof,onset_s=0.1",
    "spoof,magnitude=nan",
)  # fmt: skip


ROOT = Path(__file__).resolve().parents[2]
_READERS = (
    ("steer_by_wire.tools.can.__main__", "response-times", "dbc/*.dbc"),
    ("steer_by_wire.tools.dialect.__main__", "new", "dbc/*.dbc"),
    ("steer_by_wire.controller.command_line.program", "--check", "controller/presets/*.toml"),
    ("steer_by_wire.tools.run.__main__", "--duration=0.2", "plant_emulator/presets/*.toml"),
)
"""Programs that read a file of a stranger's, the word before it, and where whole ones are."""


class _Reached(BaseException):
    """The program has reached its work."""


class Outcome(NamedTuple):
    """How a program has ended; ``status`` is None where it has reached its work."""

    status: int | None
    out: str
    err: str


def fuzz_command_line(rng: Random) -> None:
    """Give some program some arguments."""
    module = rng.choice(tuple(PROGRAMS))
    options = options_of(module)
    words = []
    for _ in range(rng.randint(0, WORDS_MAX)):
        kind = rng.randint(0, 7)
        if kind < 3:
            words.append(rng.choice(options))
        elif kind < 5:
            words.append(rng.choice(FILES))
        elif kind == 5:
            words.append(text_of(rng, 12).replace("/", "_").replace("\0", ""))
        else:
            words.append(rng.choice(_WORDS))
    judge(module, words, run_program(module, words))


def fuzz_damaged_file(rng: Random) -> None:
    """Give a program a database or a preset that is damaged."""
    module, word, files = rng.choice(_READERS)
    content = damaged(rng, rng.choice(sorted(ROOT.glob(files))).read_bytes())
    name = f"damaged{Path(files).suffix}"
    outcome = run_program(module, [word, name], {name: content})
    judge(module, [word], outcome)
    assert outcome.status in (None, 0, 2, 4)


def judge(module: str, words: Sequence[str], outcome: Outcome) -> None:
    """Raise AssertionError for an end that no user should see."""
    status, _, err = outcome
    assert "Traceback" not in err, f"{module} {words}: {err}"
    if status is None:
        return
    assert status in range(256), f"{module} {words}: status {status}"
    assert status == 0 or bool(err.strip()), f"{module} {words}: status {status} without a word"


def run_program(
    module: str, words: Sequence[str], files: Mapping[str, bytes] = MappingProxyType({})
) -> Outcome:
    """Run a program in a folder of its own, with files, until it ends or reaches its work."""
    out, err = _terminal("strict"), _terminal("backslashreplace")
    main = importlib.import_module(module).main
    with (
        _stopped(PROGRAMS.get(module, ())),
        _folder(files),
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        try:
            status = main(list(words))
        except SystemExit as end:
            status = end.code
            assert status in (0, 2), f"{module} {words}: exits with {status}"
        except _Reached:
            status = None
    return Outcome(None if status is None else int(status), _text(out), _text(err))


@lru_cache
def options_of(module: str) -> Sequence[str]:
    """Return the options in a program's help."""
    text = run_program(module, ["--help"]).out
    return sorted(set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", text)))


@contextmanager
def _stopped(places: Sequence[str]) -> Iterator[None]:
    """Stop a program that reaches one of ``places``; leave the signals of this process alone."""
    with ExitStack() as stack:
        for place in places:
            stack.enter_context(patch(place, _stop))
        stack.enter_context(patch.object(signal, "signal", lambda *_: signal.SIG_DFL))
        stack.enter_context(patch.dict(os.environ, {"COLUMNS": "100"}))
        yield


def _stop(*_arguments: object, **_options: object) -> NoReturn:
    raise _Reached


@contextmanager
def _folder(files: Mapping[str, bytes]) -> Iterator[None]:
    with TemporaryDirectory() as folder, chdir(folder):
        for name, content in {**_contents(), **files}.items():
            Path(name).write_bytes(content)
        Path("folder").mkdir()
        yield


@lru_cache
def _contents() -> Mapping[str, bytes]:
    noise = bytes(range(256))
    study = b'name = "s"\n[base]\ncontrollers = ["practical_pd"]\n'
    study += b'[[factors]]\nkey = "plant.seed"\nvalues = [1, 2]\n'
    return {
        "run.log": faultless_log(".log"),
        "run.blf": faultless_log(".blf"),
        "noise.bin": noise,
        "noise.log": noise,
        "noise.toml": noise,
        "empty.toml": b"",
        "controller.toml": b'law = "pd"\n[pd]\nproportional_gain_rad_m = 1\n'
        b"derivative_gain_rad_s_m = 0.1\n",
        "plant.toml": b"duration_s = 1\n",
        "study.toml": study,
        "vehicle.toml": b"[vehicle]\nvirtual_mass_kg = 2000\n",
        "spec.toml": b'name = "x"\n',
    }


def _terminal(errors: str) -> io.TextIOWrapper:
    """Return a stream as Python opens it for a program's output."""
    return io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors=errors, write_through=True)


def _text(stream: io.TextIOWrapper) -> str:
    buffer = stream.buffer
    return buffer.getvalue().decode() if isinstance(buffer, io.BytesIO) else ""
