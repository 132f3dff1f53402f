"""The file of a dialect: each mistake is one line with file, key and what is allowed."""

from pathlib import Path

import pytest

from steer_by_wire.dbc.dialect.car_message import Reading, Refused
from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.settings import Quantity
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD
from steer_by_wire.runtime.node.end import End
from steer_by_wire.runtime.settings import SettingsError

CAR = Path(__file__).with_name("my_car.toml")
DBC = CAR.with_suffix(".dbc")


def changed(folder: Path, *changes: tuple[str, str]) -> Path:
    """Return a copy of the car's file, next to its database, in which texts of either differ."""
    texts = {file: file.read_text(encoding="utf-8") for file in (CAR, DBC)}
    for old, new in changes:
        file = next(file for file, text in texts.items() if old in text)
        texts[file] = texts[file].replace(old, new, 1 if file is CAR else -1)
    for file, text in texts.items():
        (folder / file.name).write_text(text, encoding="utf-8")
    return folder / CAR.name


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
    "a signal that is named twice": (
        'counter = "ANGLE_COUNTER"',
        'counter = "HAND_WHEEL_ANGLE"',
        "messages.STEER_ANGLE.counter: HAND_WHEEL_ANGLE has bits of signals.HAND_WHEEL_ANGLE",
    ),
    "a polynomial wider than the signal": (
        "polynomial = 0x2F",
        "polynomial = 0x12F",
        "messages.STEER_ANGLE.checksum.polynomial = 0x12f is wider than ANGLE_CRC"
        " (allowed: up to 0xff)",
    ),
    "a function that takes something else": (
        'rule = "sum", identifier = true, length = true',
        'rule = "math:sqrt"',
        "messages.STEER_REQUEST: no frame of it can be made: checksum rule math:sqrt raises"
        " TypeError: math.sqrt() takes exactly one argument (2 given)",
    ),
    "a car without a command": (
        'ANGLE_REQUEST = { carries = "steer_rad"',
        'ANGLE_REQUEST = { carries = "engaged"',
        "messages: no signal carries steer_rad, so no one can steer",
    ),
    "a scale of zero": (
        "(0.1,0) [-3000|3000]",
        "(0,0) [-3000|3000]",
        "messages.STEER_ANGLE.signals.HAND_WHEEL_ANGLE: the database gives HAND_WHEEL_ANGLE the"
        " scale 0",
    ),
    "a signal beyond its message": (
        "ANGLE_CRC : 24|8",
        "ANGLE_CRC : 25|8",
        "messages.STEER_ANGLE: signal ANGLE_CRC ends beyond its 4 bytes",
    ),
    "signals that overlap": (
        "ANGLE_COUNTER : 16|4@1+",
        "ANGLE_COUNTER : 17|4@0+",
        "messages.STEER_ANGLE.checksum.signal: ANGLE_CRC has bits of counter",
    ),
    "a multiplexer that the file does not name, in a signal's bits": (
        "SG_ GEAR :",
        'SG_ KIND M : 30|2@1+ (1,0) [0|0] "" CONTROLLER\n SG_ GEAR m0 :',
        "messages.MOTION.signals.YAW_RATE: YAW_RATE has bits of multiplexer KIND",
    ),
    "a multiplexer that carries something": (
        "SG_ YAW_RATE :",
        "SG_ YAW_RATE M :",
        "messages.MOTION.signals.YAW_RATE: YAW_RATE is a multiplexer, which only a constant sets",
    ),
    "a length that no frame has": (
        "STEER_ANGLE: 4 ",
        "STEER_ANGLE: 65 ",
        "messages.STEER_ANGLE: 65 bytes do not fit into a frame (allowed: up to 64)",
    ),
    "two messages with an identifier": (
        "513 ",
        "512 ",
        "messages.MOTION: has the identifier 0x200 of STEER_ANGLE",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(name: str, tmp_path: Path) -> None:
    old, new, said = MISTAKES[name]
    file = changed(tmp_path, (old, new))
    with pytest.raises(SettingsError) as refused:
        read_dialect(file)
    assert refused.value.mistakes == (f"{file}: {said}",)


@pytest.mark.parametrize("sign", ["+", "-"])
def test_counter_and_checksum_use_all_their_bits(sign: str, tmp_path: Path) -> None:
    signals = ("ANGLE_COUNTER : 16|4@1", "ANGLE_CRC : 24|8@1")
    file = changed(tmp_path, *((f"{signal}+", f"{signal}{sign}") for signal in signals))
    message = read_dialect(file).sent_by(End.PLANT)[0]
    frames = [message.frame({Quantity.WHEEL_ANGLE: 0.1}, number) for number in range(20)]
    assert [frame.data[2] for frame in frames] == [number % 16 for number in range(20)]
    assert len({frame.data[3] for frame in frames}) == 16
    assert frames == [
        read_dialect(CAR).sent_by(End.PLANT)[0].frame({Quantity.WHEEL_ANGLE: 0.1}, number)
        for number in range(20)
    ]
    said = [message.read(frame.data) for frame in frames]
    assert [one.counter for one in said if isinstance(one, Reading)] == [*range(16), *range(4)]


def test_signals_that_are_not_set_may_share_bits(tmp_path: Path) -> None:
    others = "".join(f'SG_ G{n} : {n}|9@1+ (1,0) [0|0] "" CONTROLLER\n ' for n in (24, 46, 48))
    file = changed(tmp_path, ("SG_ GEAR :", f"{others}SG_ GEAR :"))
    overlapping, own = (
        next(one for one in read_dialect(it).messages if one.name == "MOTION") for it in (file, CAR)
    )
    data = own.frame(dict.fromkeys(Quantity, 0.9), 0).data
    assert overlapping.frame(dict.fromkeys(Quantity, 0.9), 0).data == data
    assert overlapping.read(data) == own.read(data)
    assert overlapping.changeable == ["VEHICLE_SPEED", "YAW_RATE", "GEAR"]


@pytest.mark.parametrize(("length", "padded"), [(9, 12), (12, 12), (33, 48), (64, 64)])
def test_a_long_message_is_a_padded_frame_of_can_fd(
    length: int, padded: int, tmp_path: Path
) -> None:
    size = "STEER_ANGLE: 4 ", f"STEER_ANGLE: {length} "
    file = changed(tmp_path, size, ("ANGLE_CRC : 24|8", f"ANGLE_CRC : {8 * length - 8}|8"))
    message = read_dialect(file).sent_by(End.PLANT)[0]
    assert message.flags == FD | BITRATE_SWITCH
    data = message.frame({Quantity.WHEEL_ANGLE: 0.1}, 3).data
    assert data[length:] == bytes(padded - length)
    assert data[length - 1]
    other = data[:length] + b"\xcc" * (padded - length)
    assert message.read(data) == message.read(other) != Refused.WRONG_LENGTH
    moved = message.changed(other, "HAND_WHEEL_ANGLE", lambda value: value + 9.0, 1)
    assert moved is not None
    assert len(moved) == padded
    assert isinstance(message.read(moved), Reading)
    assert padded == length or message.read(data[:length]) is Refused.WRONG_LENGTH


def test_several_frames_of_j1939_are_refused(tmp_path: Path) -> None:
    file = changed(tmp_path, ("LANE: 8 ", "LANE: 9 "))
    with (tmp_path / DBC.name).open("a", encoding="utf-8") as dbc:
        kinds = '"StandardCAN","ExtendedCAN","reserved","J1939PG"'
        dbc.write(f'BA_DEF_ BO_ "VFrameFormat" ENUM {kinds};\n')
        dbc.write('BA_ "VFrameFormat" BO_ 2566834944 3;\n')
    with pytest.raises(SettingsError, match=r"LANE: 9 bytes of J1939 are several frames"):
        read_dialect(file)


@pytest.mark.parametrize("content", [None, "", "BO_ what"])
def test_a_database_that_is_none_is_one_line(content: str | None, tmp_path: Path) -> None:
    file = changed(tmp_path, ("my_car.dbc", "other.dbc"))
    if content is not None:
        (tmp_path / "other.dbc").write_text(content, encoding="utf-8")
    with pytest.raises(SettingsError) as refused:
        read_dialect(file)
    assert refused.value.mistakes[0].startswith(f"{file}: ")
