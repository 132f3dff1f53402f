"""A replay of CAN FD frames on a bus of classic ones is refused before it begins."""

from pathlib import Path

import can
import pytest

from steer_by_wire.runtime.port import socketcan
from steer_by_wire.runtime.port.python_can import BusPort
from steer_by_wire.runtime.port.socketcan import SocketCanPort
from steer_by_wire.tools.faults.__main__ import main

CLASSIC = "(0.000000) can0 040#0011223344556677\n"
FD = "(0.010000) can0 040##10011223344556677\n"
BUS = ["-i", "virtual", "-c", "fd_replay"]


def replay(folder: Path, text: str) -> int:
    log = folder / "run.log"
    log.write_text(text)
    return main(["replay,onset_s=0.01,duration_s=1", "--recording", str(log), *BUS])


def test_a_log_with_can_fd_frames_is_refused_at_the_start_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay(tmp_path, CLASSIC + FD) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    assert f"{tmp_path / 'run.log'}: has CAN FD frames" in printed.err
    assert "give --fd" in printed.err


def test_a_log_of_classic_frames_is_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay(tmp_path, CLASSIC * 2) == 0
    assert "2 frames sent" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("protocol", "takes_fd"), [(can.CanProtocol.CAN_20, False), (can.CanProtocol.CAN_FD, True)]
)
def test_a_bus_reports_whether_it_takes_can_fd_frames(
    protocol: can.CanProtocol, takes_fd: bool
) -> None:
    with can.Bus(interface="virtual", channel="fd_told", protocol=protocol) as bus:
        assert BusPort(bus).takes_fd is takes_fd


@pytest.mark.parametrize(
    ("fd", "mtu", "takes_fd"),
    [(True, "72\n", True), (True, "16\n", False), (False, "72\n", False), (True, None, True)],
)
def test_a_network_interface_takes_what_it_was_opened_for_and_carries(
    fd: bool, mtu: str | None, takes_fd: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socketcan, "_NETWORK_INTERFACES", tmp_path)
    if mtu is not None:
        (tmp_path / "can9").mkdir()
        (tmp_path / "can9" / "mtu").write_text(mtu)
    port = SocketCanPort.__new__(SocketCanPort)  # this machine need not have one
    port._channel, port._fd = "can9", fd
    assert port.takes_fd is takes_fd
