"""The file of a dialect: each mistake is one line with file, key and what is allowed."""

import shutil
from pathlib import Path

import pytest

from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.settings import Quantity
from steer_by_wire.runtime.settings import SettingsError

CAR = Path(__file__).with_name("my_car.toml")
DBC = CAR.with_suffix(".dbc")


def changed(folder: Path, old: str, new: str) -> Path:
    """Return a copy of the car's file in which one text differs."""
    text = CAR.read_text(encoding="utf-8")
    assert old in text
    shutil.copy(DBC, folder)
    file = folder / CAR.name
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    return file


def test_a_whole_car_is_read() -> None:
    dialect = read_dialect(CAR)
    assert [one.name for one in dialect.messages] == [
        "STEER_REQUEST",
        "STEER_ANGLE",
        "MOTION",
        "LANE",
    ]
    assert dialect.carried == set(Quantity) - {Quantity.APPLYING}


MISTAKES = {
    "a signal that the database lacks": (
        "signals.YAW_RATE",
        "signals.YAW_RAT",
        "messages.MOTION.signals.YAW_RAT: MOTION has no signal YAW_RAT (did you mean YAW_RATE?)",
    ),
    "a message that it lacks": (
        "[messages.MOTION]",
        "[messages.MOTIONS]",
        "messages.MOTIONS: my_car.dbc has no such message (did you mean MOTION?)",
    ),
    "a cycle of zero": (
        "cycle_ms = 20",
        "cycle_ms = 0",
        "messages.MOTION.cycle_ms = 0 should be greater than or equal to 1"
        " (allowed: number from 1.0, up to 60000.0)",
    ),
    "a rule that there is not": (
        'rule = "sum", identifier',
        'rule = "xor", identifier',
        "messages.STEER_REQUEST.checksum: there is no rule 'xor' (allowed: sum, crc,"
        " e2e_p01, e2e_p05, e2e_p11, package.module:ATTRIBUTE)",
    ),
    "a module that there is not": (
        'rule = "sum", identifier = true, length = true',
        'rule = "no_such:rule"',
        "messages.STEER_REQUEST.checksum: the rule no_such:rule is not there: ModuleNotFoundError: "
        "No module named 'no_such'",
    ),
    "a constant that does not fit": (
        "TORQUE_MAX = 10.0",
        "TORQUE_MAX = 26.0",
        "messages.STEER_REQUEST.constants.TORQUE_MAX = 26.0 (allowed: 0 to 25.5)",
    ),
    "a name that the signal has not": (
        'GEAR = "D"',
        'GEAR = "R"',
        "messages.MOTION.constants.GEAR = 'R' (allowed: P, D)",
    ),
    "a measurement of the controller's": (
        '"wheel_angle_rad"',
        '"steer_rad"',
        "messages.STEER_ANGLE.signals.HAND_WHEEL_ANGLE: steer_rad is sent by the controller",
    ),
    "a ratio of zero": (
        "ratio = -1.0",
        "ratio = 0.0",
        "messages.LANE.signals.LATERAL_OFFSET.ratio = 0 (allowed: any number but 0)",
    ),
    "one of ours with an identifier of the car": (
        'dbc = "my_car.dbc"',
        'dbc = "my_car.dbc"\nkeep = ["STEERING_COMMAND"]',
        "messages.STEER_REQUEST: has the identifier 0x100 of STEERING_COMMAND, which is kept",
    ),
    "a message of ours that there is not": (
        'dbc = "my_car.dbc"',
        'dbc = "my_car.dbc"\nkeep = ["LATERAL_ERRORS"]',
        "keep: LATERAL_ERRORS is no message of ours (did you mean LATERAL_ERROR?)",
    ),
    "nobody who steers": (
        'ANGLE_REQUEST = { carries = "steer_rad"',
        'ANGLE_REQUEST = { carries = "engaged"',
        "messages: no signal carries steer_rad, so that nobody can steer",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(name: str, tmp_path: Path) -> None:
    old, new, said = MISTAKES[name]
    file = changed(tmp_path, old, new)
    with pytest.raises(SettingsError) as refused:
        read_dialect(file)
    assert refused.value.mistakes == (f"{file}: {said}",)


@pytest.mark.parametrize("content", [None, "", "BO_ what"])
def test_a_database_that_is_none_is_one_line(content: str | None, tmp_path: Path) -> None:
    file = changed(tmp_path, "my_car.dbc", "other.dbc")
    if content is not None:
        (tmp_path / "other.dbc").write_text(content, encoding="utf-8")
    with pytest.raises(SettingsError) as refused:
        read_dialect(file)
    assert refused.value.mistakes[0].startswith(f"{file}: ")
