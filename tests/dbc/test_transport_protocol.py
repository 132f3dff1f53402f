"""Long J1939 messages in segments, against what can-j1939 sends."""

from pathlib import Path

from steer_by_wire.dbc.j1939_transport import LENGTH_MAX, segments
from steer_by_wire.runtime.frame import EXTENDED, Frame


def test_segments_are_the_frames_of_another_implementation() -> None:
    lines = Path(__file__).with_name("j1939_messages.txt").read_text(encoding="ascii").splitlines()
    for can_id, payload, *texts in map(str.split, lines):
        theirs = [
            Frame(int(identifier, 16), bytes.fromhex(data), EXTENDED)
            for identifier, data in (text.split("#") for text in texts)
        ]
        assert list(segments(int(can_id, 16), bytes.fromhex(payload))) == theirs
    assert len(lines) > 10


def test_a_group_with_a_destination_is_announced_without_it() -> None:
    announcement, *_ = segments(0x18EF_2A_17, bytes(9))
    assert announcement == Frame(0x1CECFF17, bytes.fromhex("20090002FF00EF00"), EXTENDED)


def test_the_longest_message_has_255_packets() -> None:
    _, *data = segments(0x18FECA17, bytes(LENGTH_MAX))
    assert [frame.data[0] for frame in data] == list(range(1, 256))
