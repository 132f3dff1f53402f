"""Messages of any database as traffic."""

from pathlib import Path

import pytest

from steer_by_wire.dbc.foreign_messages import ListedMessage, read_message_set
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD

OURS = Path(__file__).parents[2] / "dbc" / "steer_by_wire.dbc"

OTHER = """VERSION ""
BU_: A B
BO_ 2566844926 TRUCK: 8 A
 SG_ x : 0|8@1+ (1,0) [0|0] "" B
BO_ 512 WIDE: 9 B
 SG_ y : 0|8@1+ (1,0) [0|0] "" A
"""


def test_the_steering_messages_are_listed_with_their_cycle_times() -> None:
    listed = {message.name: message for message in read_message_set(OURS)}
    assert listed["STEERING_COMMAND"] == ListedMessage(
        "STEERING_COMMAND", 0x100, 0, 8, 10, ("CONTROLLER",)
    )
    assert listed["LATENCY_CONFIG"].cycle_ms is None


def test_identifiers_of_29_bits_and_lengths_of_can_fd_are_kept(tmp_path: Path) -> None:
    file = tmp_path / "other.dbc"
    file.write_text(OTHER)
    truck, wide = read_message_set(file)
    assert (truck.can_id, truck.flags, truck.length) == (0x18FEF1FE, EXTENDED, 8)
    # Nine bytes are sent as twelve.
    assert (wide.flags, wide.length, wide.senders) == (FD | BITRATE_SWITCH, 12, ("B",))


@pytest.mark.parametrize("text", ["BO_ x", "\x00\xff"])
def test_what_is_no_database_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "bad.dbc"
    file.write_text(text)
    with pytest.raises(ValueError, match=r"bad\.dbc: [^\n]*$"):
        read_message_set(file)
