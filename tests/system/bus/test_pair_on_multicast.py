"""The pair on python-can's ``udp_multicast``, which delivers to everybody what he has sent."""

import random
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.plant_emulator.settings import PlantSettings
from tests.support.programs.driven_pair import BEAR_ALL, drive_pair
from tests.support.programs.running_program import PATIENCE_S


def multicast() -> Bus:
    """A group for private use, which does not leave the host; skips where there is none."""
    group = ".".join(str(random.SystemRandom().randrange(1, 255)) for _ in range(3))
    bus = Bus("udp_multicast", f"239.{group}", {"hop_limit": "0"})
    try:
        with (
            can.Bus(interface=bus.interface, channel=bus.channel, hop_limit=0) as one,
            can.Bus(interface=bus.interface, channel=bus.channel, hop_limit=0) as other,
        ):
            one.send(can.Message(arbitration_id=1, is_extended_id=False))
            assert other.recv(PATIENCE_S)
    except (can.CanError, OSError) as error:
        pytest.skip(f"no multicast on this machine: {error}")
    return bus


def test_a_pair_on_multicast_sees_no_second_sender(tmp_path: Path) -> None:
    result = drive_pair(multicast(), tmp_path, PlantSettings(duration_s=1.0, overruns=BEAR_ALL))
    for report in (result.plant, result.controller):
        assert report["node"]["second_senders"] == []
        assert "own_identifier" not in report["node"]["rejected"]
        assert report["node"]["accepted"] > 0
