"""The DBC itself, and that the typed messages and the documentation say the same as it does."""

import re
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple, get_type_hints

import pytest
from cantools.database.can import Message as Definition
from cantools.database.can.signal import Signal

from steer_by_wire.controller.laws import LAWS
from steer_by_wire.dbc.codec.codec import FILE, ContractError, MessageCodec
from steer_by_wire.dbc.codec.protection import header_bits, protect
from steer_by_wire.dbc.contract.dbc_file import layouts_of, load_database, parse_database
from steer_by_wire.dbc.contract.layout_from_dbc import FILE as LAYOUT
from steer_by_wire.dbc.contract.layout_from_dbc import generated_text
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    DATA_IDS,
    MESSAGE_TYPES,
    Decoded,
    Direction,
    DisturbanceConfig,
    LatencyModel,
    LateralError,
    LawNumber,
    Message,
    SteeringCommand,
    decode,
    encode,
    frame_of,
    limits,
)
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import command_of, latency_of, message_with

DATABASE = load_database()
DOCUMENT = (Path(__file__).parents[2] / "docs" / "wire_contract.md").read_text(encoding="utf-8")
PROTECTED = [each for each in DATABASE.messages if MESSAGE_TYPES[each.name] in DATA_IDS]

# How a unit is written at the end of a name; the longest that fits counts.
UNIT_AT_THE_END = re.compile(r"_(1_m|n_m|m_s2|m_s|rad_s|rad|kg|m|n|s)$")
UNIT_IN_THE_DBC = {
    "1_m": "1/m",
    "n_m": "N m",
    "m_s2": "m/s^2",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "rad": "rad",
    "kg": "kg",
    "m": "m",
    "n": "N",
    "s": "s",
}


def payload_signals(definition: Definition) -> list[Signal]:
    """The signals a typed message has fields for, in the order of their bits."""
    header = header_bits(definition.name)
    return [signal for signal in definition.signals if signal.name not in header]


def attribute(definition: Definition, name: str) -> float | str | None:
    """A message's attribute, None where the DBC's default holds."""
    assert definition.dbc is not None
    found = definition.dbc.attributes.get(name)
    return None if found is None else found.value


def test_every_field_has_the_name_and_the_unit_of_its_signal() -> None:
    for name, message_type in MESSAGE_TYPES.items():
        definition = DATABASE.get_message_by_name(name)
        fields = list(get_type_hints(message_type))
        found = []
        for field in fields:
            unit = UNIT_AT_THE_END.search(field)
            bare = field[: unit.start()] if unit else field
            found.append((bare.upper(), UNIT_IN_THE_DBC[unit[1]] if unit else None))
        prefix = f"{name}_"
        signals = payload_signals(definition)
        assert found == [(signal.name.removeprefix(prefix), signal.unit) for signal in signals]


def test_every_message_has_a_type_and_every_type_a_message() -> None:
    assert list(MESSAGE_TYPES) == [message.name for message in DATABASE.messages]
    assert list(MESSAGE_TYPES.values()) == list(CAN_IDS)
    assert list(CAN_IDS.values()) == [message.frame_id for message in DATABASE.messages]


def test_every_value_table_is_the_enum_of_its_field() -> None:
    for name, message_type in MESSAGE_TYPES.items():
        signals = payload_signals(DATABASE.get_message_by_name(name))
        for (field, kind), signal in zip(
            get_type_hints(message_type).items(), signals, strict=True
        ):
            table = {int(raw): str(text) for raw, text in (signal.choices or {}).items()}
            if issubclass(kind, IntEnum):
                assert table == {member.value: member.name for member in kind}, field
                assert limits(message_type)[field] == (min(table), max(table))
            elif table:
                assert table == {-(1 << signal.length - 1): "NOT_AVAILABLE"}, field


def test_everything_has_a_comment() -> None:
    assert DATABASE.buses[0].comment
    for node in DATABASE.nodes:
        assert node.comment, node.name
    for message in DATABASE.messages:
        assert message.comment, message.name
        for signal in message.signals:
            assert signal.comment, (message.name, signal.name)


@pytest.mark.parametrize(
    ("name", "can_id", "sender", "receivers", "cycle_ms"),
    [
        ("STEERING_COMMAND", 0x100, "CONTROLLER", {"PLANT"}, 10),
        ("STEERING_PLAN", 0x101, "CONTROLLER", {"PLANT"}, None),
        ("SPEED_REQUEST", 0x104, "CONTROLLER", {"PLANT"}, None),
        ("LATERAL_ERROR", 0x110, "PLANT", {"CONTROLLER"}, 10),
        ("STEERING_STATUS", 0x120, "PLANT", {"CONTROLLER"}, 10),
        ("STEERING_FORCE", 0x128, "PLANT", {"CONTROLLER", "HAND_WHEEL"}, None),
        ("VEHICLE_STATE", 0x130, "PLANT", {"CONTROLLER"}, 20),
        ("SHARP_PATH", 0x138, "PLANT", {"CONTROLLER"}, None),
        ("PATH_AHEAD", 0x140, "PLANT", {"CONTROLLER"}, None),
        ("HAND_WHEEL_STATE", 0x180, "HAND_WHEEL", {"CONTROLLER", "PLANT"}, None),
        ("HAND_WHEEL_FEEDBACK", 0x190, "CONTROLLER", {"HAND_WHEEL", "PLANT"}, None),
        ("CONTROLLER_STATUS", 0x300, "CONTROLLER", {"PLANT", "TOOL"}, 100),
        ("CONTROLLER_SAFETY", 0x304, "CONTROLLER", {"PLANT", "TOOL"}, 100),
        ("DELAY_STATUS", 0x308, "CONTROLLER", {"PLANT", "TOOL"}, 100),
        ("MODEL_STATUS", 0x30C, "CONTROLLER", {"TOOL"}, None),
        ("PLANT_STATUS", 0x310, "PLANT", {"CONTROLLER", "TOOL"}, 100),
        ("GROUND_TRUTH", 0x314, "PLANT", {"TOOL"}, None),
        ("HAND_WHEEL_STATUS", 0x318, "HAND_WHEEL", {"CONTROLLER", "PLANT", "TOOL"}, None),
        ("CAR_TRUTH", 0x31C, "PLANT", {"TOOL"}, None),
        ("LATENCY_CONFIG", 0x320, "TOOL", {"PLANT"}, None),
        ("DISTURBANCE_CONFIG", 0x324, "TOOL", {"PLANT"}, None),
        ("LATENCY_SET", 0x328, "TOOL", {"PLANT"}, None),
        ("DISTURBANCE_SET", 0x32C, "TOOL", {"PLANT"}, None),
    ],
)
def test_a_message_is_sent_by_whom_to_whom_and_how_often(
    name: str, can_id: int, sender: str, receivers: set[str], cycle_ms: int | None
) -> None:
    definition = DATABASE.get_message_by_name(name)
    assert definition.frame_id == can_id
    assert not definition.is_extended_frame
    assert definition.senders == [sender]
    assert definition.cycle_time == cycle_ms
    # Messages also sent on change declare that at the signals that change (test_dbc_attributes).
    unsent = "NoMsgSendType" if sender == "TOOL" else "IfActive"
    assert definition.send_type == (unsent if cycle_ms is None else "Cyclic")
    for signal in definition.signals:
        assert set(signal.receivers) == receivers, signal.name


def test_the_steering_command_wins_every_arbitration() -> None:
    assert min(CAN_IDS.values()) == CAN_IDS[SteeringCommand]


def test_every_periodic_message_is_protected_under_a_data_id_of_its_own() -> None:
    data_ids = [attribute(definition, "E2EDataId") for definition in PROTECTED]
    assert len(set(data_ids)) == len(PROTECTED)
    assert all(data_ids)  # neither absent nor the DBC's default, 0
    for definition in DATABASE.messages:
        header = {
            signal.name: (signal.start, signal.length)
            for signal in definition.signals
            if signal.name in header_bits(definition.name)
        }
        if definition in PROTECTED:
            assert attribute(definition, "E2EProfile") == 1  # "PROFILE_05" of the enumeration
            assert header == header_bits(definition.name)
        else:
            assert header == {}
            assert attribute(definition, "E2EDataId") is None
            assert definition.cycle_time is None


def test_a_unit_becomes_part_of_a_name_or_is_refused() -> None:
    text = (Path(__file__).parents[2] / "dbc" / FILE).read_text("ascii")
    for unit, field in (("N.m", "lateral_error_n_m"), ("N m/rad", "lateral_error_n_m_rad")):
        changed = re.sub(r'(SG_ LATERAL_ERROR_LATERAL_ERROR .*)"m"', rf'\1"{unit}"', text)
        layouts = {layout.name: layout for layout in layouts_of(parse_database(changed))}
        assert layouts["LATERAL_ERROR"].signals[0].field == field
    changed = re.sub(r'(SG_ LATERAL_ERROR_LATERAL_ERROR .*)"m"', r'\1"%"', text)
    with pytest.raises(ContractError, match="its unit '%' cannot be part of a name"):
        layouts_of(parse_database(changed))


def test_a_field_whose_unit_is_not_the_dbcs_is_refused() -> None:
    class InMillimetres(NamedTuple):
        lateral_error_mm: float
        heading_error_rad: float

    layout = next(layout for layout in layouts_of(DATABASE) if layout.name == "LATERAL_ERROR")
    with pytest.raises(KeyError, match="lateral_error_mm"):
        MessageCodec(layout, InMillimetres)


def test_the_bits_that_nobody_uses_are_ignored() -> None:
    for definition in DATABASE.messages:
        raws = {
            signal.name: 1 if signal.minimum is None or signal.minimum <= signal.scale else 0
            for signal in definition.signals
        }
        payload = bytearray(definition.encode(raws, scaling=False))
        used = {one.start + bit for one in definition.signals for bit in range(one.length)}
        unused = {*range(8 * definition.length)} - used
        word = int.from_bytes(payload, "little") | sum(1 << bit for bit in unused)
        filled = bytearray(word.to_bytes(definition.length, "little"))
        message_type = MESSAGE_TYPES[definition.name]
        if message_type in DATA_IDS:
            protect(payload, DATA_IDS[message_type])
            protect(filled, DATA_IDS[message_type])
        sent = decode(frame_of(definition.frame_id, bytes(payload)))
        assert isinstance(sent, Decoded)
        assert decode(frame_of(definition.frame_id, bytes(filled))) == sent
        assert encode(*sent).data == bytes(payload)


def test_the_document_names_the_vehicle_and_the_times_that_are_our_defaults() -> None:
    vehicle = PlantSettings().vehicle
    wheelbase_m = round(vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m, 4)
    section = DOCUMENT.split("## What another controller or plant must know")[1].split("\n## ")[0]
    for text in (
        f"{vehicle.front_axle_distance_m} m behind the front axle and "
        f"{vehicle.rear_axle_distance_m} m ahead",
        f"wheelbase {wheelbase_m} m",
        f"{vehicle.preview_distance_m} m ahead of the centre of gravity",
    ):
        assert text in section
    assert all(DATA_IDS[kind] == 0x5000 + CAN_IDS[kind] for kind in DATA_IDS)


def test_the_documented_cansend_line_is_the_frame_it_says() -> None:
    lines = re.findall(r"^cansend \S+ (\w{3})#(\w+) +# (.*)$", DOCUMENT, re.MULTILINE)
    found = {text: Frame(int(can_id, 16), bytes.fromhex(data)) for can_id, data, text in lines}
    expected: dict[str, Message] = {
        "80 ms, standard deviation 30 ms, loss 1 %, normal, both directions": latency_of(
            Direction.BOTH, 0.08, 0.03, 0.01, model=LatencyModel.NORMAL
        ),
        "no latency, no loss": latency_of(Direction.BOTH),
        "side force of 1500 N to the left": message_with(DisturbanceConfig, side_force_n=1500.0),
        "no disturbance": message_with(DisturbanceConfig),
    }
    assert found == {text: encode(message, 0) for text, message in expected.items()}
    for name in ("LATENCY_CONFIG", "DISTURBANCE_CONFIG"):
        definition = DATABASE.get_message_by_name(name)
        example = re.search(rf"{definition.frame_id:X}#(\w+)", str(definition.comment))
        assert example is not None
        frame = Frame(definition.frame_id, bytes.fromhex(example[1]))
        assert frame in found.values()
        assert decode(frame) != decode(frame._replace(data=bytes(7)))


def test_the_documented_frames_of_a_controller_hold_what_they_say() -> None:
    lines = re.findall(r"^(1\d\d)#(\w+) ", DOCUMENT, re.MULTILINE)
    frames = [Frame(int(can_id, 16), bytes.fromhex(data)) for can_id, data in lines]
    assert frames == [
        encode(message_with(LateralError, lateral_error_m=0.05, heading_error_rad=-0.01), 7),
        encode(command_of(-0.075), 0),
    ]


def test_the_document_names_the_limits_of_a_steer() -> None:
    limits_of_plant = PlantSettings().safety
    assert (
        f"The plant limits {limits_of_plant.angle_rad_max} rad, "
        f"{limits_of_plant.angle_rate_rad_s_max} rad/s, "
        f"{limits_of_plant.lateral_acceleration_m_s2_max:g} m/s² and "
        f"{limits_of_plant.lateral_jerk_m_s3_max:g} m/s³"
    ) in DOCUMENT


def test_every_law_on_the_wire_is_a_module_but_the_one_of_other_packages() -> None:
    own = [law for law in LawNumber if law is not LawNumber.CUSTOM]
    assert {name: law.number for name, law in LAWS.items()} == {
        law.name.lower(): law for law in own
    }


def test_the_generated_layout_is_what_the_dbc_gives_byte_for_byte() -> None:
    expected = generated_text().encode("ascii")
    made_by = "run python -m steer_by_wire.dbc.contract.layout_from_dbc"
    assert LAYOUT.read_bytes() == expected, made_by
