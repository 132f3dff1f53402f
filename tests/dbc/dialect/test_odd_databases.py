"""Databases as other tools write them: read right, or refused with the reason."""

import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import Dialect, read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.dbc.dialect.proposal import proposal
from steer_by_wire.dbc.dialect.reader import listening_to
from steer_by_wire.dbc.foreign_messages import cycle_ms_of, load_database, read_message_set
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.node.end import End
from steer_by_wire.runtime.settings import SettingsError

COMMAND, FLAG = "BO_ 256 LKAS_CMD: 8 CAM\n", ' SG_ REQ_ACTIVE : 16|1@1+ (1,0) [0|1] "" EPS\n'
ANGLE = ' SG_ ANGLE_REQ : 7|16@0- (0.1,0) [-3276.8|3276.7] "deg" EPS\n'
STEERING = "BO_ 512 STEERING: 8 EPS\n"
WHEEL = ' SG_ STEER_ANGLE : 7|16@0- (0.1,0) [-3276.8|3276.7] "deg" CAM\n'
CAR = f'VERSION ""\nBU_: EPS CAM\n{COMMAND}{ANGLE}{FLAG}\n{STEERING}{WHEEL}\n'
CYCLE = 'BA_DEF_ BO_ "GenMsgCycleTime" FLOAT 0 3600000;\nBA_DEF_DEF_ "GenMsgCycleTime" {};\n'


def mapped(folder: Path, text: str, encoding: str = "cp1252") -> tuple[str, Dialect]:
    """The first mapping of a database, and what it says."""
    database, file = folder / 'a "car".dbc', folder / "car.toml"
    database.write_text(text, encoding=encoding)
    mapping = proposal(load_database(database).messages, database)
    file.write_text(mapping, encoding="utf-8")
    return mapping, read_dialect(file)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8-sig", "utf-16"])
def test_a_database_is_read_with_any_byte_order_mark(tmp_path: Path, encoding: str) -> None:
    text = CAR.replace('"deg" CAM', '"°" CAM').replace('"deg" EPS', '"rad" EPS')
    mapping, dialect = mapped(tmp_path, text, encoding)
    assert [one.name for one in dialect.messages] == ["LKAS_CMD", "STEERING"]
    assert "by its name, unit '°'" in mapping
    assert """unit = "SI", ratio = 15.0 }  # guess: by its name, unit 'rad'""" in mapping


def test_one_signed_bit_is_1_on_the_wire(tmp_path: Path) -> None:
    _, dialect = mapped(tmp_path, CAR.replace("16|1@1+ (1,0) [0|1]", "16|1@1- (1,0) [0|0]"))
    command = dialect.messages[0]
    frame = command.frame(dict.fromkeys(command.carries, 1.0), 0)
    assert frame.data[2] == 1
    reading = command.read(frame.data)
    assert 1.0 in reading.values.values()  # type: ignore[union-attr]


NAMES = st.text(
    st.characters(codec="cp1252", exclude_categories=["Cc", "Lu", "Ll"], exclude_characters='"\\')
)
"""Without letters, which would make words, such as RATE, that a signal is recognised by."""


@given(name=NAMES.filter(str.strip), message=NAMES.filter(str.strip))
def test_a_first_mapping_is_toml_whatever_the_names(
    name: str, message: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    database = tmp_path_factory.mktemp("car") / "car.dbc"
    database.write_text(CAR, encoding="cp1252")
    messages = load_database(database).messages
    messages[0].name = message
    messages[0].signals[0].name = f"angle_req {name}"
    messages[0].refresh(strict=False)
    tables = tomllib.loads(proposal(messages, database))
    assert f"angle_req {name}" in tables["messages"][message]["signals"]


@given(cycle_ms=st.floats(0.05, 3_600_000))
def test_a_first_mapping_has_cycles_that_a_dialect_takes(
    cycle_ms: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    cycle = f'{CYCLE.format(0)}BA_ "GenMsgCycleTime" BO_ 512 {cycle_ms:.3f};\n'
    _, dialect = mapped(tmp_path_factory.mktemp("car"), CAR + cycle)
    expected = min(max(float(f"{cycle_ms:.3f}"), 1.0), 60_000.0)
    assert dialect.messages[1].settings.cycle_ms == pytest.approx(expected, rel=1e-4)


LAYOUT = st.tuples(
    st.integers(0, 63), st.integers(1, 64), st.integers(0, 1), st.sampled_from("+-"),
    st.sampled_from(["0.1", "-0.1", "0", "1e-9"]),
)  # fmt: skip


@given(command=LAYOUT, flag=LAYOUT, wheel=LAYOUT, can_id=st.sampled_from([256, 272, 512]))
def test_what_is_proposed_is_what_check_takes(
    command: tuple[object, ...], flag: tuple[object, ...], wheel: tuple[object, ...],
    can_id: int, tmp_path_factory: pytest.TempPathFactory,
) -> None:  # fmt: skip
    file = tmp_path_factory.mktemp("car") / "car.dbc"
    line = ' SG_ {} : {}|{}@{}{} ({},0) [0|0] "deg" EPS\n'
    steering = f"BO_ {can_id} STEERING: 8 EPS\n" + line.format("STEER_ANGLE", *wheel)
    signals = line.format("ANGLE_REQ", *command) + line.format("REQ_ACTIVE", *flag)
    file.write_text(f'VERSION ""\nBU_: EPS CAM\n{COMMAND}{signals}\n{steering}\n')
    mapping = file.with_suffix(".toml")
    mapping.write_text(proposal(load_database(file).messages, file))
    try:
        read_dialect(mapping)
    except SettingsError as error:
        assert "LKAS_CMD" not in tomllib.loads(mapping.read_text()).get("messages", {})
        assert re.search("no signal carries steer_rad|messages is missing", str(error))  # noqa: PT017


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("FLOAT 0 9999", "20.0"),
        ("HEX 0 9999", "20"),
        ('ENUM "10","20"', "1"),
        ("STRING", '"20 ms"'),
    ],
)
def test_a_cycle_is_read_from_an_attribute_of_any_type(
    tmp_path: Path, kind: str, value: str
) -> None:
    file = tmp_path / "car.dbc"
    cycle = f'BA_DEF_ BO_ "GenMsgCycleTime" {kind};\nBA_ "GenMsgCycleTime" BO_ 512 {value};\n'
    file.write_text(CAR + cycle)
    assert [cycle_ms_of(one) for one in load_database(file).messages] == [None, 20.0]
    _, dialect = mapped(tmp_path, CAR + cycle)
    assert dialect.messages[1].settings.cycle_ms == 20.0


def test_an_error_of_a_file_without_line_ends_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "page.dbc"
    file.write_text("<html>" + "x" * 10_000)
    with pytest.raises(ValueError, match=r"no \.dbc file") as refused:
        load_database(file)
    assert len(str(refused.value)) < 600


DOUBTFUL = {
    "messages of the database have this name: 0x200, 0x400": (
        f"{STEERING}{WHEEL}\n{STEERING.replace('512', '1024')}{WHEEL}"
    ),
    "under several values of a multiplexer: STEER_ANGLE": (
        f'{STEERING} SG_ KIND M : 39|8@0+ (1,0) [0|255] "" CAM\n'
        + WHEEL.replace("ANGLE ", "ANGLE m0 ")
        + WHEEL.replace("ANGLE ", "ANGLE m1 ")
    ),
}


@pytest.mark.parametrize("why", DOUBTFUL)
def test_a_name_that_two_have_is_left_out_or_refused_with_the_reason(
    tmp_path: Path, why: str
) -> None:
    mapping, dialect = mapped(tmp_path, CAR.replace(STEERING + WHEEL, DOUBTFUL[why]))
    assert "# STEERING is left out: " in mapping
    assert why in mapping
    assert [one.name for one in dialect.messages] == ["LKAS_CMD"]
    file = tmp_path / "car.toml"
    file.write_text(f"{mapping}\n[messages.STEERING]\ncycle_ms = 10\n", encoding="utf-8")
    with pytest.raises(SettingsError, match=f"messages.STEERING: .*{why}"):
        read_dialect(file)


def test_a_default_cycle_is_that_of_what_is_sent_in_cycles(tmp_path: Path) -> None:
    file = tmp_path / "event.dbc"
    kinds = 'BA_DEF_ BO_ "GenMsgSendType" ENUM "Cyclic","Event";\n'
    kinds += 'BA_DEF_DEF_ "GenMsgSendType" "Cyclic";\nBA_ "GenMsgSendType" BO_ 512 1;\n'
    file.write_text(CAR + CYCLE.format(100) + kinds)
    assert [one.cycle_ms for one in read_message_set(file)] == [100, None]
    file.write_text(CAR + CYCLE.format(100) + kinds + 'BA_ "GenMsgCycleTime" BO_ 512 50;\n')
    assert [cycle_ms_of(one) for one in load_database(file).messages] == [100, 50]


BUS = '<Bus name="{0}"><Message id="{1}" name="{0}_DOORS" length="8"/></Bus>'


def test_messages_of_several_buses_are_no_traffic_of_one(tmp_path: Path) -> None:
    file = tmp_path / "car.kcd"
    start = '<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document name="x"/>'
    one, two = BUS.format("BODY", "0x100"), BUS.format("CHASSIS", "0x101")
    file.write_text(f"{start}{one}</NetworkDefinition>")
    assert [message.name for message in read_message_set(file)] == ["BODY_DOORS"]
    file.write_text(f"{start}{one}{two}</NetworkDefinition>")
    for path in (file, Path(f"{file}:ENGINE")):
        with pytest.raises(
            ValueError, match=r"buses BODY, CHASSIS.* choose one, as .*car\.kcd:BODY"
        ):
            read_message_set(path)
    chosen = read_message_set(Path(f"{file}:CHASSIS"))
    assert [message.name for message in chosen] == ["CHASSIS_DOORS"]


@given(priority=st.integers(0, 7), source=st.integers(0, 255), to=st.integers(0, 255))
def test_j1939_is_heard_by_its_group_whatever_address_sends(
    priority: int, source: int, to: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    j1939 = 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    j1939 += 'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'
    ids = {"256 L": f"{0x8C00FEFE} L", "512 S": f"{0x98F009FE} S"}  # to one address, and to all
    text = CAR + j1939
    for old, new in ids.items():
        text = text.replace(f"BO_ {old}", f"BO_ {new}")
    _, dialect = mapped(tmp_path_factory.mktemp("car"), text)
    listening = listening_to(dialect)
    node = Gateway(ControllerNode(controller_preset("practical_pd"), 0), dialect, End.CONTROLLER, 0)
    node.on_frame(Frame(priority << 26 | 0xF00900 | source, bytes(8), EXTENDED), 0)
    assert node.report()["dialect"]["accepted"] == 1
    for can_id, name in ((to << 8, "LKAS_CMD"), (0xF00900, "STEERING")):
        whole = priority << 26 | can_id | source
        assert (
            listening.hear(Frame(whole, bytes([0, 0, 1, 0, 0, 0, 0, 0]), EXTENDED), 0).name == name
        )
    assert not listening.hear(Frame(0x18F00A00 | source, bytes(8), EXTENDED), 0).name


def test_a_j1939_message_of_another_source_address_is_named(tmp_path: Path) -> None:
    text = CAR.replace("BO_ 512 S", f"BO_ {0x98F0090A} S")
    text += 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    text += f'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";\nBA_ "VFrameFormat" BO_ {0x98F0090A} 3;\n'
    _, dialect = mapped(tmp_path, text)
    named = dialect.of_other_addresses([0x123, 0x18F0090B, 0x18F00A0B])
    assert [line.partition(" has")[0] for line in named] == ["18F0090B"]
    assert "of STEERING (18F0090A)" in named[0]
