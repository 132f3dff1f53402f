"""Every example runs, leaves its picture, and comes to the figure it shows."""

import os
import runpy
import shlex
import shutil
import subprocess
import sys
from base64 import b64decode
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import can
import nbformat
import pytest
from nbclient import NotebookClient

import steer_by_wire
from steer_by_wire import simulate
from steer_by_wire.closed_loop.lockstep.peer import LockstepProgram
from steer_by_wire.closed_loop.lockstep.record import FRAMES, Arrival, Record
from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.closed_loop.rig.rig import Rig
from steer_by_wire.dbc.messages import Decoded, decode, encode
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import FD, Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.runtime.port.socketcan import SocketCanPort
from tests.support.frames.made_messages import error_of
from tests.support.programs.running_program import PATIENCE_S, RunningProgram, running
from tests.support.runs.example_checks import CHECKS

pytest_plugins = ["pytester"]

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples"
DBC = ROOT / "dbc" / "steer_by_wire.dbc"
GALLERY = runpy.run_path(str(ROOT / "docs" / "conf.py"))["sphinx_gallery_conf"]
PNG = b"\x89PNG\r\n\x1a\n"
LIVE = ("--set", "duration_s=3", "--set", "safety.ftti_ms=off", "--preset", "paper_nominal")


OF_NODES = ("own_car", "networked_prediction", "packetised_mpc")
"""Examples with a model or law that is not compiled; of the others a compiled run is, bit for bit,
what the nodes do (tests/closed_loop/compiled)."""


@pytest.fixture(autouse=True)
def _examples(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.syspath_prepend(str(EXAMPLES / "foreign_controller_c"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NotebookClient]:
    """One kernel for all notebooks, which takes a second to start; each begins without names."""
    client = NotebookClient(nbformat.v4.new_notebook(), timeout=PATIENCE_S)
    home = tmp_path_factory.mktemp("ipython")
    with client.setup_kernel(env={**os.environ, "IPYTHONDIR": str(home)}):
        yield client


PREPARED = """
import gc, os, sys
os.chdir({folder!r})
sys.path.append({root!r})
from steer_by_wire import simulate
simulate.__kwdefaults__["engine"] = {engine!r}
gc.freeze()  # else the reset collects a million objects that stay
%reset -f
"""
CHECKED = """
from tests.support.runs.example_checks import CHECKS
CHECKS[{name!r}](made)
"""


@pytest.mark.parametrize("name", CHECKS)
def test_an_example_works_as_a_notebook_in_an_empty_folder(
    name: str, tmp_path: Path, client: NotebookClient
) -> None:
    from sphinx_gallery.py_source_parser import (
        split_code_and_text_blocks,  # with it Sphinx, which no test for vcan0 needs
    )

    engine = "virtual" if name in OF_NODES else "compiled"
    prepared = PREPARED.format(folder=str(tmp_path), root=str(ROOT), engine=engine)
    _, blocks = split_code_and_text_blocks(str(EXAMPLES / f"{name}.py"))
    codes = [block.content for block in blocks if block.type == "code"]
    *before, last = codes
    rest, start, program = last.partition('if __name__ == "__main__":')
    codes = [*before, rest + start + program.replace("main()", "(made := main())")]
    codes = [prepared, *codes, CHECKED.format(name=name), GALLERY["last_notebook_cell"]]
    client.nb = nbformat.v4.new_notebook(cells=list(map(nbformat.v4.new_code_cell, codes)))
    *_, shown = client.execute(cleanup_kc=False).cells
    pictures = [b64decode(each["data"]["image/png"]) for each in shown.outputs]
    assert (tmp_path / "out" / "examples" / f"{name}.png").read_bytes() in pictures
    assert all(picture.startswith(PNG) for picture in pictures)


def test_every_example_is_tested_and_listed() -> None:
    names = {path.name for path in EXAMPLES.iterdir() if path.suffix in ("", ".py")}
    names -= {"__pycache__", "out"}  # out: left by make docs
    assert {f"{name}.py" for name in CHECKS} <= names
    text = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert [name for name in sorted(names) if f"({name}" not in text] == []


def test_the_library_page_names_every_public_name() -> None:
    text = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
    assert [name for name in steer_by_wire.__all__ if f"`{name}" not in text] == []


class ForeignNode:
    """The foreign controller in virtual time: it has no deadline, it answers."""

    deadline_ns, finished = NEVER_NS, False

    def __init__(self, controller: Any) -> None:
        self._controller = controller
        self.heard: list[bytes] = []
        self.said: list[bytes] = []

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        message = can.Message(
            timestamp=now_ns * 1e-9, arbitration_id=frame.can_id, data=bytearray(frame.data)
        )
        answer = self._controller.on_message(message)
        if answer is None:
            return ()
        self.heard.append(frame.data)
        self.said.append(bytes(answer.data))
        return (Frame(answer.arbitration_id, bytes(answer.data)),)

    def on_tick(self, _now_ns: int) -> Sequence[Frame]:
        return ()


@cache
def foreign_run() -> tuple[PlantNode, ForeignNode]:
    example: ModuleType = import_module("foreign_controller")
    # The rig shows its path to a controller that answers, from the first measurement on.
    plant = PlantNode(PlantSettings(duration_s=20.0), 0)
    node = ForeignNode(example.ForeignController(DBC))
    VirtualTimeExecutor((plant, node)).run(NEVER_NS)
    return plant, node


def test_a_controller_from_the_dbc_alone_holds_the_path_as_ours_does() -> None:
    plant, node = foreign_run()
    report = plant.report()
    assert report["accepted"] == len(node.said) == 2001
    assert report["rejected"] == {}
    assert report["failure"] == ""
    follows = {"controller.followed_point": "preview"}
    ours = simulate(controller="practical_pd", duration_s=20.0, overrides=follows)
    assert report["preview_rms_m"] == pytest.approx(ours.preview_rms_m, rel=0.05)


def test_it_drives_a_plant_in_another_process(tmp_path: Path) -> None:
    with launched_broker() as address:
        bus = ("-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={address}")
        report = tmp_path / "plant.json"
        with running("steer_by_wire.plant_emulator", [*bus, *LIVE], report) as plant:
            plant.wait_for("ready")
            finished = run_foreign(
                [sys.executable, str(EXAMPLES / "foreign_controller.py"), str(DBC), *bus]
            )
            judge_live(plant, finished)
    assert (tmp_path / "out" / "examples" / "foreign_controller.png").read_bytes().startswith(PNG)


def run_foreign(command: Sequence[str]) -> str:
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def judge_live(plant: RunningProgram, printed: str) -> None:
    """Only what a stalled machine cannot spoil: frames flow, and are believed."""
    plant.end()
    report = plant.report()
    assert "commands sent" in printed
    assert report["node"]["accepted"] > 50
    assert not set(report["node"]["rejected"]) & {"bad_crc", "wrong_length", "out_of_range"}


QEMU_M7 = shlex.split(
    "qemu-system-arm -M mps2-an500 -nographic -serial none -monitor none"
    " -semihosting-config enable=on,target=native -icount shift=0,sleep=off -kernel"
)
needs_a_c_compiler = pytest.mark.skipif(
    shutil.which("cc") is None or sys.platform != "linux",
    reason="no C compiler, or no SocketCAN: the controller in C was not compiled",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the layout in C is generated, and each program compiled, once."""
    folder = tmp_path_factory.mktemp("controller_in_c")
    generate = [sys.executable, "-m", "cantools", "generate_c_source", str(DBC)]
    subprocess.run(generate, cwd=folder, check=True, capture_output=True)
    return folder


@needs_a_c_compiler
def test_the_controller_in_c_sends_the_same_bytes(folder: Path) -> None:
    tests: Any = import_module("test_controller")
    _, node = foreign_run()
    spoilt = [Frame(0x110, bytes(8)), Frame(0x100, node.said[0]), Frame(0x110, bytes(1))]
    heard = [Frame(0x110, data) for data in node.heard]
    foreign = 0, Frame(0x200, bytes(12), FD)  # whose place in the record the answer takes
    said: list[Arrival] = []
    with LockstepProgram([tests.build(folder, "on_lockstep")]) as program:
        for frame in (*spoilt, *heard, heard[-1]):  # the last one is a repetition
            said += program.exchange(Record(FRAMES, 0, [foreign, (0, frame)])).frames
    assert [frame for _, frame in said] == [Frame(0x100, data) for data in node.said]


@needs_a_c_compiler
def test_a_library_makes_the_run_of_the_program(tmp_path: Path, folder: Path) -> None:
    tests: Any = import_module("test_controller")
    rig = Rig(tmp_path, overrides={"duration_s": 1.0})
    runs = [
        rig.run([tests.build(folder, name)], lockstep=True).files.candump_log.read_bytes()
        for name in ("on_lockstep", "lockstep.so", "lockstep.so")
    ]
    assert runs[0] == runs[1] == runs[2]


@needs_a_c_compiler
@pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None or shutil.which("qemu-system-arm") is None,
    reason="no arm-none-eabi-gcc or qemu-system-arm: nothing ran on a Cortex-M7",
)
def test_a_cortex_m7_sends_the_same_bytes_as_the_host(tmp_path: Path, folder: Path) -> None:
    tests: Any = import_module("test_controller")
    rig = Rig(tmp_path, overrides={"duration_s": 1.0, "latency.downlink.mean_s": 0.02})
    host = rig.run([tests.build(folder, "on_lockstep")], lockstep=True)
    m7 = rig.run([*QEMU_M7, tests.build(folder, "on_m7.elf")], lockstep=True)
    assert host.ending == m7.ending == ""
    assert m7.files.candump_log.read_bytes() == host.files.candump_log.read_bytes()
    assert m7.report["accepted"] > 60


@needs_a_c_compiler
@pytest.mark.vcan
def test_the_controller_in_c_answers_on_vcan0(folder: Path) -> None:
    tests: Any = import_module("test_controller")
    bus = SocketCanPort("vcan0", [{"can_id": 0x100, "can_mask": 0x7FF, "extended": False}])
    command = [tests.build(folder, "on_vcan", "-O0"), "vcan0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == b"ready\n"
        for counter in range(20):
            assert bus.send(encode(error_of(0.1), counter))
            answer = bus.recv(PATIENCE_S)
            assert answer is not None
            command_frame = decode(answer.frame)
            assert isinstance(command_frame, Decoded)
            assert command_frame.counter == counter
            assert command_frame.message.steer_rad < 0.0
        assert program.wait(PATIENCE_S) == 0  # the plant has fallen silent
    bus.shutdown()


@needs_a_c_compiler
def test_the_rig_drives_the_controller_in_c_and_finds_the_broken_one(
    pytester: pytest.Pytester,
) -> None:
    file = EXAMPLES / "foreign_controller_c" / "test_controller.py"
    without = ("xdist", "cacheprovider", "_hypothesis_pytestplugin")
    options = [word for plugin in without for word in ("-p", f"no:{plugin}")]
    result = pytester.runpytest_inprocess(str(file), "-k", "virtual_time", *options)
    result.assert_outcomes(passed=3, deselected=1)
