"""Arguments of ``tools/with_vcan``, and its one file: none of it needs a vcan0."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from steer_by_wire.with_vcan import request as request_module
from steer_by_wire.with_vcan.__main__ import main
from steer_by_wire.with_vcan.request import Request, interface_names, link_commands, netem_of


def test_netem_delays_every_frame_of_its_interface() -> None:
    """In the kernel: the queue is there before the command, and long enough."""
    request = Request(("true",), ("vcan0", "vcan1"), netem_of(["vcan1:delay 9ms"], ["vcan1"]))
    assert link_commands(request)[-1] == [
        *("tc", "qdisc", "add", "dev", "vcan1", "root"),
        *("netem", "limit", "100000", "delay", "9ms"),
    ]  # fmt: skip
    own_limit = request._replace(netem=(("vcan0", ("limit", "5")),))
    assert link_commands(own_limit)[-1][-3:] == ["netem", "limit", "5"]


@pytest.mark.parametrize(
    ("text", "names"),
    [("1", ["vcan0"]), ("3", ["vcan0", "vcan1", "vcan2"]), ("can0,a.b-c", ["can0", "a.b-c"])],
)
def test_interfaces_are_a_number_or_names(text: str, names: list[str]) -> None:
    assert list(interface_names(text)) == names


@pytest.mark.parametrize("text", ["0", "65", "", "a,,b", "a,a", "0can", "a/b", "a" * 16, "-1", "²"])
def test_what_is_no_interface_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"interface|1 to 64"):
        interface_names(text)


def test_netem_is_for_all_interfaces_or_for_one() -> None:
    both = ["vcan0", "vcan1"]
    assert dict(netem_of(["delay 1ms 2ms"], both)) == dict.fromkeys(both, ("delay", "1ms", "2ms"))
    assert dict(netem_of(["loss 1%", "vcan1:delay 1ms"], both))["vcan1"] == ("delay", "1ms")
    for wrong in ("vcan2:delay 1ms", "vcan0:", ""):
        with pytest.raises(ValueError, match=r"interface|parameters"):
            netem_of([wrong], both)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--timeout", "0", "true"],
        ["--timeout", "nan", "true"],
        ["--interfaces", "0", "true"],
        ["--memory", "1", "true"],
        ["--netem", "vcan9:delay 1ms", "true"],
        ["--backend", "qemu", "true"],
    ],
    ids=" ".join,
)
def test_wrong_arguments_are_reported_before_anything_starts(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert "with-vcan: error: " in capsys.readouterr().err


def test_where_there_is_no_way_the_packages_to_install_are_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr(request_module, "SYSTEM_FOLDERS", "/nowhere")
    assert main(["--interfaces", "nocan0", "true"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    for word in (
        "nocan0",
        "user-mode-linux kmod can-utils iproute2",
        "host: ",
        "namespace: ",
        "uml: ",
    ):
        assert word in line


def test_on_another_processor_no_package_is_named_that_does_not_exist_for_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: "aarch64")
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr(request_module, "SYSTEM_FOLDERS", "/nowhere")
    assert main(["--interfaces", "nocan0", "true"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "uml: User Mode Linux is for x86, not aarch64" in line
    assert "user-mode-linux" not in line


def test_one_file_is_all_it_takes(tmp_path: Path) -> None:
    file, again = tmp_path / "with-vcan", tmp_path / "again"
    assert main(["--write-single-file", str(file)]) == 0
    alone = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    version = subprocess.run(
        [sys.executable, "-I", str(file), "--help"], env=alone, capture_output=True, text=True
    )
    assert version.returncode == 0
    assert "COMMAND" in version.stdout
    (unpacked,) = (tmp_path / ".cache" / "with-vcan").iterdir()
    assert (unpacked / "with_vcan" / "xstate.c").is_file()
    main(["--write-single-file", str(again)])
    assert again.read_bytes() == file.read_bytes()


def test_one_file_that_cannot_be_written_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--write-single-file", "/no/such/folder/file"]) == 4
    assert "/no/such/folder/file: No such file" in capsys.readouterr().err
