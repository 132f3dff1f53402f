"""Faults of a plant in a dialect: on the car's frames, in its names, as its database reads them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_plant
from steer_by_wire.closed_loop.rig import Rig
from steer_by_wire.dbc.bus_language import read_language
from steer_by_wire.plant_emulator.faults.messages_on_bus import messages_in, naming
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS
from steer_by_wire.runtime.settings import SettingsError, load_settings
from tests.dbc.dialect.test_gateway import CAR, DATABASE, request

LANGUAGE = read_language(CAR)
ANGLE_ID, MOTION_ID, LANE_ID = 0x200, 0x201, DATABASE.get_message_by_name("LANE").frame_id


def settings(*faults: str) -> PlantSettings:
    tables = ", ".join(f"{{onset_s = 0.5, {fault}}}" for fault in faults)
    return load_settings(
        PlantSettings, overrides=[f"faults = [{tables}]"], context=naming(LANGUAGE)
    )


def sent(*faults: str) -> list[tuple[int, Frame]]:
    """Return the frames of a plant that gets the car's request every 10 ms, with their times."""
    _, edge = make_virtual_plant(settings(*faults), language=LANGUAGE)
    frames: list[tuple[int, Frame]] = []
    for number in range(100):
        now_ns = 10 * NS_PER_MS * number
        while edge.deadline_ns <= now_ns:
            at_ns = edge.deadline_ns
            frames += [(at_ns, frame) for frame in edge.on_tick(at_ns)]
        frames += [(now_ns, one) for one in edge.on_frame(request(2.0, number), now_ns)]
    return frames


def is_late(at_ns: int) -> bool:
    """Whether the fault is active, which counts from the first request, at 0."""
    return at_ns >= 500 * NS_PER_MS


def values(frames: Sequence[tuple[int, Frame]], can_id: int) -> list[tuple[int, dict[str, Any]]]:
    """Return what cantools reads in the frames of a message."""
    return [
        (at_ns, DATABASE.decode_message(can_id, frame.data, decode_choices=False))
        for at_ns, frame in frames
        if frame.can_id == can_id
    ]


def crc_is_right(frame: Frame) -> bool:
    """Whether the CRC of STEER_ANGLE fits, computed bit by bit as AUTOSAR's CRC-8 with 0x2F."""
    crc = 0xFF
    for byte in frame.data[:3]:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x2F if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF == frame.data[3]


@pytest.mark.parametrize(
    ("kind", "magnitude", "expected"),
    [
        ("offset", 90.0, lambda sound: sound + 90.0),
        ("scale", -2.0, lambda sound: -2.0 * sound),
        ("offset", 1e6, lambda _: 3000.0),  # the end of the range in the database
    ],
)
def test_a_value_is_wrong_in_the_car_s_unit_and_counter_and_checksum_are_right(
    kind: str, magnitude: float, expected: Any
) -> None:
    fault = f'kind = "{kind}", direction = "uplink", message = "STEER_ANGLE"'
    fault += f', signal = "HAND_WHEEL_ANGLE", magnitude = {magnitude}'
    frames = sent(fault)
    sound, faulty = values(sent(), ANGLE_ID), values(frames, ANGLE_ID)
    assert len(sound) == len(faulty) > 90
    for (at_ns, before), (_, after) in zip(sound, faulty, strict=True):
        angle = before["HAND_WHEEL_ANGLE"]
        wanted = expected(angle) if is_late(at_ns) else angle
        assert after["HAND_WHEEL_ANGLE"] == pytest.approx(wanted, abs=0.11)
        assert after["ANGLE_COUNTER"] == before["ANGLE_COUNTER"]
    assert all(crc_is_right(frame) for _, frame in frames if frame.can_id == ANGLE_ID)


def test_a_raw_value_leaves_the_range_and_a_frame_its_identifier() -> None:
    outside = 'kind = "out_of_range", direction = "uplink", message = "LANE"'
    moved = 'kind = "wrong_identifier", direction = "uplink", message = "STEER_ANGLE"'
    frames = [(at_ns, frame) for at_ns, frame in sent(outside, moved) if is_late(at_ns)]
    assert {abs(one["LATERAL_OFFSET"]) > 32.0 for _, one in values(frames, LANE_ID)} == {True}
    ids = {frame.can_id for _, frame in frames}
    assert ids == {MOTION_ID, LANE_ID}
    assert {len(frame.data) for _, frame in frames if frame.can_id == MOTION_ID} == {4, 8}


def test_a_fault_of_the_request_is_refused_by_the_car_s_rules(tmp_path: Path) -> None:
    def refused(fault: str) -> Any:
        tables = [{"onset_s": 0.5, "direction": "downlink", "message": "STEER_REQUEST"} | fault]
        rig = Rig(tmp_path, overrides={"duration_s": 1.0, "faults": tables}, dialect=CAR)
        outcome = rig.run("practical_pd")
        (reported,) = outcome.report["faults"]
        assert (reported["message"], reported["changed"] > 40) == ("STEER_REQUEST", True)
        return outcome.report["dialect"]["refused"]

    assert refused({"kind": "bit_flips", "magnitude": 0.5}).keys() >= {"bad checksum"}
    assert refused({"kind": "offset", "signal": "REQUEST_ACTIVE"}).keys() == {"not engaged"}


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        (
            'kind = "drop", direction = "uplink", message = "LATERAL_ERROR"',
            "faults[0]: message of the uplink must be STEER_ANGLE, MOTION, LANE or all (the car's,"
            " as --dialect says), not 'LATERAL_ERROR'",
        ),
        (
            'kind = "offset", direction = "uplink", message = "STEER_ANGLE", signal = "ANGLE_CRC"',
            "faults[0]: signal of STEER_ANGLE must be HAND_WHEEL_ANGLE, not 'ANGLE_CRC'",
        ),
        (
            'kind = "wrong_identifier", direction = "downlink"',
            "faults[0]: wrong_identifier can happen to no message of the downlink (the car's, as"
            " --dialect says)",
        ),
    ],
)
def test_a_name_that_is_not_the_car_s_is_refused_in_one_line(fault: str, line: str) -> None:
    with pytest.raises(SettingsError) as error:
        settings(fault)
    assert str(error.value) == f"command line: {line}"


def test_settings_with_our_names_are_refused_in_a_dialect() -> None:
    ours = load_settings(
        PlantSettings,
        overrides=['faults = [{kind = "drop", direction = "uplink", message = "LATERAL_ERROR"}]'],
    )
    with pytest.raises(SettingsError, match="must be STEER_ANGLE, MOTION, LANE or all"):
        make_virtual_plant(ours, language=LANGUAGE)


def test_onsets_count_from_the_first_request_that_the_car_takes() -> None:
    messages = messages_in(LANGUAGE)
    refused = (request(0.0, 0, active=0), request(0.0, 1, spoilt=1), Frame(7, bytes(8)))
    assert not any(messages.starts(frame, 0) for frame in refused)
    assert messages.starts(request(0.0, 2), 0)
