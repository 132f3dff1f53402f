"""A signal that is added to every message breaks neither node, nor what reads their frames."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import steer_by_wire
from steer_by_wire.dbc.messages import MESSAGE_TYPES

ROOT = Path(steer_by_wire.__file__).parent
CONTRACT = Path("steer_by_wire/dbc/contract")
RUN = (
    *("run", "--duration", "1", "--ideal-wire"),
    *("--set", "plant.latency.downlink.mean_s=0.1", "--set", "plant.ground_truth=true"),
)
PACKET = ("--preset", "practical_packet", "--set", "plant.path_ahead.reach_s=1.5")


SIGNAL = re.compile(r" SG_ (\w+) : (\d+)\|(\d+)@1([+-]) \((.*),0\) \[(.*)\|(.*)\] (.*)\n")


def _with_one_more(message: str) -> str:
    """Return the text of a message in the DBC with a signal ADDED of one bit, which is 0.

    A message that is full gives the highest bit of its last signal for it.
    """
    name, size = re.findall(r"BO_ \d+ (\w+): (\d+)", message)[0]
    last = max(SIGNAL.finditer(message), key=lambda found: int(found[2]))
    signal, start, length, sign, scale, low, high, rest = last.groups()
    free = int(start) + int(length)
    if free == 8 * int(size):
        free -= 1
        largest = (2 ** (int(length) - 2 if sign == "-" else int(length) - 1) - 1) * float(scale)
        low, high = (str(max(-largest, float(low))), str(min(largest, float(high))))
    kept = f" SG_ {signal} : {start}|{free - int(start)}@1{sign} ({scale},0) [{low}|{high}] {rest}"
    added = f' SG_ {name}_ADDED : {free}|1@1+ (1,0) [0|1] "" {rest.split()[-1]}'
    return f"{message[: last.start()]}{kept}\n{message[last.end() :]}{added}\n"


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the product in which each message has one signal more."""
    folder = tmp_path_factory.mktemp("changed")
    shutil.copytree(ROOT, folder / "steer_by_wire", ignore=shutil.ignore_patterns("__pycache__"))
    dbc = folder / "steer_by_wire/dbc/steer_by_wire.dbc"
    text = dbc.read_text(encoding="ascii")
    new = re.sub(r"BO_ \d+ \w+: .*\n( SG_ .*\n)+", lambda found: _with_one_more(found[0]), text)
    # The value "not available" is the lowest of the shorter signal.
    new = re.sub(r"(HEADING_ERROR) -16384", r"\1 -8192", new)
    dbc.write_text(new, encoding="ascii")
    records = folder / CONTRACT / "message_records.py"
    fields = r"(class \w+\(NamedTuple\):\n(?:(?!\n\n\n).)*)"
    records.write_text(
        re.sub(fields, r"\1\n    added: int = 0", records.read_text("utf-8"), flags=re.DOTALL),
        encoding="utf-8",
    )
    _run(folder, "-m", "steer_by_wire.dbc.contract.layout_from_dbc")
    layout = (folder / CONTRACT / "generated_layout.json").read_text(encoding="ascii")
    assert layout.count("ADDED") == text.count("\nBO_ ") == len(MESSAGE_TYPES)
    return folder


def _run(folder: Path | None, *command: str) -> None:
    """Run a program, of the product that lies in ``folder``."""
    # Another PYTHONPATH makes it a process of its own, which imports from there.
    environment = {**os.environ, "PYTHONPATH": str(folder)} if folder else None
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, env=environment, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("options", [(), PACKET], ids=["commands", "plans"])
def test_a_signal_added_to_each_message_changes_no_run(
    changed: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    whole = tmp_path / "out"
    _run(None, "-m", "steer_by_wire", *RUN, *options, "--out", str(whole))
    other = changed / f"out_{len(options)}"
    _run(changed, "-m", "steer_by_wire", *RUN, *options, "--out", str(other))
    trace = (other / "plant_trace.csv").read_bytes()
    assert trace == (whole / "plant_trace.csv").read_bytes()
    assert trace.count(b"\n") > 100
    assert (other / "candump.log").read_bytes() != (whole / "candump.log").read_bytes()
