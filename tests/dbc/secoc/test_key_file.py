"""The key comes from a file that no other user can read, and is shown nowhere."""

import os
import stat
import sys
import traceback
from pathlib import Path
from types import SimpleNamespace

import pytest

from steer_by_wire.dbc.messages import ControllerStatus, encode
from steer_by_wire.dbc.secoc.key_file import _obstacle, cmac_maker, open_authentication, read_key
from steer_by_wire.runtime.settings import SettingsError
from tests.support.frames.made_messages import message_with

pytestmark = pytest.mark.skipif(
    not hasattr(os, "geteuid"), reason="this platform does not report who may read a file"
)

KEY = bytes.fromhex("c0ffee00112233445566778899aabbcc")
DIGITS = KEY.hex()
TEXT = b"whatever is authenticated"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "steer.key"
    path.write_text(DIGITS + "\n", encoding="ascii")
    path.chmod(0o600)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(SettingsError) as caught:
        read_key(path)
    (line,) = str(caught.value).splitlines()
    assert str(path) in line
    return line


def told_by(caught: pytest.ExceptionInfo[SettingsError]) -> str:
    """The traceback with all local variables but the test's own."""
    error = caught.value
    shown = traceback.TracebackException(type(error), error, caught.tb.tb_next, capture_locals=True)
    return "".join(shown.format())


@pytest.mark.parametrize("mode", [0o600, 0o400, 0o700])
@pytest.mark.parametrize("text", [DIGITS, DIGITS + "\n", DIGITS.upper() + "\r\n"])
def test_a_private_file_with_32_hexadecimal_digits_is_a_key(
    file: Path, mode: int, text: str
) -> None:
    file.chmod(0o600)
    file.write_bytes(text.encode("ascii"))
    file.chmod(mode)
    assert read_key(file)(TEXT) == cmac_maker()(KEY)(TEXT)


@pytest.mark.parametrize("bit", [1 << shift for shift in range(6)])
def test_a_file_that_others_may_use_in_any_way_is_refused(file: Path, bit: int) -> None:
    file.chmod(0o600 | bit)
    line = refusal(file)
    assert f"(mode {0o600 | bit:04o}): chmod 600 it" in line


def test_a_file_of_another_user_is_refused_unless_that_is_root() -> None:
    for owner, user, allowed in (
        (1000, 1000, True),
        (0, 1000, True),
        (0, 0, True),
        (1000, 0, False),
        (1001, 1000, False),
    ):
        found = os.stat_result((stat.S_IFREG | 0o600, 1, 1, 1, owner, owner, 33, 0, 0, 0))
        assert (_obstacle(found, user) == "") is allowed


def test_a_symbolic_link_is_refused_wherever_it_leads(file: Path) -> None:
    link = file.with_name("link")
    link.symlink_to(file)
    assert "is a symbolic link" in refusal(link)


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe, 0o600)
    assert "is not a regular file" in refusal(pipe)
    directory = tmp_path / "directory"
    directory.mkdir(0o700)
    assert "is not a regular file" in refusal(directory)
    assert "No such file" in refusal(tmp_path / "missing")
    assert "is not a regular file" in refusal(Path("/dev/null"))


def test_a_key_in_the_place_of_its_files_name_is_not_repeated() -> None:
    with pytest.raises(SettingsError) as caught:
        read_key(Path(DIGITS))
    assert str(caught.value) == "--key-file takes the name of a file, and this is a key"


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"\n",
        DIGITS[:-1].encode(),
        DIGITS.encode() + b"0",
        DIGITS.encode() * 2,
        DIGITS.encode() + b"\n\n",
        b" " + DIGITS[1:].encode(),
        DIGITS[:-1].encode() + b" ",
        DIGITS[:10].encode() + b" " * 12 + DIGITS[:10].encode(),
        DIGITS[:-1].encode() + b"g",
        DIGITS[:-1].encode() + b"\xff",
        KEY,
        KEY * 100_000,
    ],
)
def test_what_is_no_key_is_refused_without_showing_it(file: Path, text: bytes) -> None:
    file.write_bytes(text)
    with pytest.raises(SettingsError) as caught:
        read_key(file)
    assert str(caught.value) == f"{file}: a key is 32 hexadecimal digits on one line"
    reported = told_by(caught)
    for shown in (DIGITS[:10], DIGITS[:10].upper(), repr(KEY)[2:-1]):
        assert shown not in reported


def test_no_object_gives_the_key_away(file: Path) -> None:
    """Neither by its text nor by any attribute that leads to bytes or text."""
    authentication = open_authentication(file, ["PLANT"])
    seen: set[int] = set()
    queue: list[object] = [authentication, read_key(file)]
    while queue:
        found = queue.pop()
        if id(found) in seen or isinstance(found, type):
            continue
        seen.add(id(found))
        assert DIGITS not in repr(found).lower()
        assert repr(KEY)[2:-1] not in repr(found)
        queue += list(vars(found).values()) if hasattr(found, "__dict__") else []
        queue += [cell.cell_contents for cell in getattr(found, "__closure__", None) or ()]
    assert len(seen) > 10


def test_every_start_has_a_challenge_of_its_own_and_a_higher_counter(file: Path) -> None:
    status = encode(message_with(ControllerStatus), 0)
    sent = [open_authentication(file, ["PLANT"]).secure(status).data for _ in range(3)]
    assert len({data[8:16] for data in sent}) == 3
    counters = [int.from_bytes(data[24:32], "big") for data in sent]  # [us] of the wall clock
    assert 1_700_000_000_000_000 < counters[0] < counters[1] < counters[2]


def test_without_cryptography_one_line_says_what_to_install(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cryptography.hazmat.primitives.cmac", None)
    with pytest.raises(SettingsError, match=r"pip install .*\[secoc\]'") as caught:
        read_key(file)
    reported = told_by(caught)
    assert DIGITS[:10] not in reported


def test_a_platform_that_cannot_report_who_may_read_is_refused(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("steer_by_wire.dbc.secoc.key_file.os", SimpleNamespace())
    assert "does not report who may read" in refusal(file)
