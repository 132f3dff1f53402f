"""A program with a node that does little, on python-can's bus in one process."""

import argparse
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import View
from steer_by_wire.runtime.program.node_options import make_parser
from steer_by_wire.runtime.program.run_node import run_node
from steer_by_wire.runtime.settings import Settings
from tests.support.programs.running_program import ORDINARY

NAME = "some-program"
Options = Callable[..., argparse.Namespace]


class SomeSettings(Settings):
    gain: float = 1.0
    words: str = ""


class Probe:
    """A node that ticks ``ticks`` times, at every wake-up, and does ``on_tick_do`` each time."""

    def __init__(
        self,
        ticks: int = 3,
        on_tick_do: Callable[[], None] = lambda: None,
        on_report_do: Callable[[], None] = lambda: None,
        sends: Sequence[Frame] = (),
    ) -> None:
        self._deadline_ns = 0
        self._ticks_left = ticks
        self._on_tick_do = on_tick_do
        self._on_report_do = on_report_do
        self._sends = sends

    @property
    def deadline_ns(self) -> int:
        return self._deadline_ns

    @property
    def finished(self) -> bool:
        return not self._ticks_left

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self._deadline_ns = now_ns + 1
        self._ticks_left -= 1
        self._on_tick_do()
        return self._sends

    def on_unauthenticated(self) -> None: ...

    def view(self, _now_ns: int) -> View:
        return View({"mode": "PROBING"}, {"ticks missed": 3}, "")

    def report(self) -> Mapping[str, Any]:
        self._on_report_do()
        return {"rms_m": float("nan"), "counts": {"lost": 2}}


@pytest.fixture
def presets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    directory = tmp_path / "some_presets"
    directory.mkdir()
    (directory / "__init__.py").write_text("")
    (directory / "strong.toml").write_text("gain = 2.0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return directory.name


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> str:
    return str(request.node.name)


@pytest.fixture
def options(presets: str, channel: str) -> Callable[..., argparse.Namespace]:
    def parse(*arguments: str) -> argparse.Namespace:
        bus = ("-i", "virtual", "-c", channel)
        parser = make_parser(NAME, "Does little.", NAME, presets, SomeSettings)
        return parser.parse_args([*bus, *ORDINARY, *arguments])

    return parse


@pytest.fixture(autouse=True)
def restored_signals() -> Iterator[None]:
    """No test leaves a handler behind, or dies of a signal that it sends itself."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


def run(options: argparse.Namespace, node: Probe) -> ExitStatus:
    return run_node(NAME, options, SomeSettings(), lambda _start_ns: node)
