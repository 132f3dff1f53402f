"""Whatever a small file asks for, reading it ends in time, in little memory and in one line."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from steer_by_wire.runtime import input_file
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.input_file import bounded
from steer_by_wire.runtime.program.priority_and_memory_lock import no_collections
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.runtime.settings.settings import read_table

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="bounded on Linux only")
HUGE = """BU_: A
BO_ 100 M: 8 A
 SG_ S : 0|99999999@1+ (1,0) [0|0] "" A
"""


def test_a_signal_of_millions_of_bits_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "huge.dbc"
    file.write_text(HUGE)
    # In a process of its own: one that has freed much memory need not ask for more.
    command = [sys.executable, "-m", "steer_by_wire", "can", "response-times", str(file)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == ExitStatus.SETTINGS
    (line,) = result.stderr.splitlines()
    assert "huge.dbc: takes more than 256 MB to read" in line


def test_a_key_of_thousands_of_parts_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(input_file, "SECONDS_MAX", 0.2)
    file = tmp_path / "long.toml"
    file.write_text(".".join("a" * 9000) + " = 1\n")
    # An interrupted finaliser of another object would count as a failure.
    with (
        no_collections(),
        pytest.raises(SettingsError, match=r"long\.toml: takes longer than 0\.2 s to read"),
    ):
        read_table(file, "a")


def test_a_device_is_too_long() -> None:
    with pytest.raises(SettingsError, match="/dev/zero: is longer than 32 MB"):
        read_table(Path("/dev/zero"), "a")


def test_an_outer_timer_goes_on() -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGVTALRM, lambda number, _frame: heard.append(number))
    signal.setitimer(signal.ITIMER_VIRTUAL, 0.05)
    with bounded("a file"):
        pass
    while not heard:
        pass
    signal.signal(signal.SIGVTALRM, before)
    assert heard == [signal.SIGVTALRM]
