"""Findings of fuzzing, in words: each of these once ended in a traceback, or did not end."""

import argparse
import importlib.resources
from collections.abc import Callable
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.dbc.codec.codec import ContractError, codecs_of
from steer_by_wire.dbc.contract.dbc_file import layouts_of, parse_database
from steer_by_wire.dbc.messages import MESSAGE_TYPES
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.command_line import output_file
from steer_by_wire.runtime.settings import SettingsError, load_settings

DBC = (
    importlib.resources.files("steer_by_wire.dbc").joinpath("steer_by_wire.dbc").read_text("ascii")
)


def refusal(load: Callable[[], object]) -> str:
    with pytest.raises(SettingsError) as raised:
        load()
    for mistake in raised.value.mistakes:
        assert mistake.isprintable()
    return str(raised.value)


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (b"a = " + b"[" * 3000 + b"]" * 3000, "nested more than 30 deep"),
        (b".".join([b"a"] * 3000) + b" = 1", "nested more than 30 deep"),
        (b"seed = " + b"1" * 5000, "Exceeds the limit"),
        (b"seed = 0x" + b"f" * 5000, "seed has more than 1024 bits"),
        (b"path.kind = []", "path.kind"),
        (b'"a\\nb\\u001b[2J" = 1', r"a\nb\x1b[2J is not a known key"),
    ],
)
def test_a_settings_file_beyond_reading_is_refused_in_one_line_that_names_it(
    tmp_path: Path, content: bytes, reported: str
) -> None:
    file = tmp_path / "plant.toml"
    file.write_bytes(content)
    text = refusal(lambda: load_settings(PlantSettings, file=file))
    assert text.startswith(str(file))
    assert reported in text


@pytest.mark.parametrize("stamp", ["999999999999.0", "9999999999.0"])
def test_a_time_that_no_log_can_have_is_a_line_that_is_not_read(tmp_path: Path, stamp: str) -> None:
    file = tmp_path / "run.log"
    file.write_text(f"({stamp}) vcan0 123#11\n(1600000000.0) vcan0 123#11\n")
    figures, _ = analyse_files([file])
    assert (figures["frames"], figures["unreadable"]) == (1, 1)


def test_a_log_without_lines_has_an_end() -> None:
    if not Path("/dev/zero").exists():
        pytest.skip("there is no /dev/zero")
    with pytest.raises(LogError, match="no text"):
        analyse_files([Path("/dev/zero")])


def test_an_enumeration_that_the_dbc_makes_wider_than_ours_is_refused_when_it_is_read() -> None:
    wider = DBC.replace("_MODE : 58|3@1+ (1,0) [0|3]", "_MODE : 58|3@1+ (1,0) [0|7]")
    assert wider != DBC
    with pytest.raises(ContractError, match="STEERING_COMMAND: STEERING_COMMAND_MODE: 0 to 7"):
        codecs_of(layouts_of(parse_database(wider)), MESSAGE_TYPES.items())


@pytest.mark.parametrize(
    "text",
    ["", "\0", DBC[: len(DBC) // 3], DBC[: DBC.index("BA_DEF_")], DBC.replace("0.00001", "0")],
)
def test_a_damaged_dbc_is_reported_in_one_line(text: str) -> None:
    with pytest.raises(ContractError) as raised:
        codecs_of(layouts_of(parse_database(text)), MESSAGE_TYPES.items())
    assert str(raised.value).startswith("steer_by_wire.dbc: ")
    assert len(str(raised.value).splitlines()) == 1


def test_a_name_that_no_file_can_have_is_reported_by_the_option() -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="too long"):
        output_file("9" * 5000)
