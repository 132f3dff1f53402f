"""The pair on python-can's ``udp_multicast``, which delivers to everybody what he has sent."""

import random
import time
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.live_bus import Bus
from steer_by_wire.closed_loop.pair_result import PairFiles
from steer_by_wire.closed_loop.start_live_pair import LivePair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.node.overruns import OverrunSettings
from tests.support.running_program import PATIENCE_S

BEAR_ALL = OverrunSettings(overruns_max="off", missed_periods_max="off")
PLANT = PlantSettings(duration_s=1.0, overruns=BEAR_ALL)
CONTROLLER = controller_preset("practical_pd_ddob").model_copy(update={"overruns": BEAR_ALL})


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
    files = PairFiles(tmp_path)
    files.write_settings(PLANT, CONTROLLER)
    with LivePair(multicast(), files) as pair:
        until_s = time.monotonic() + PATIENCE_S
        while pair.plant_is_running:
            assert time.monotonic() < until_s, "the plant does not come to its end"
            time.sleep(0.05)
    result = pair.result()
    for report in (result.plant, result.controller):
        assert report["node"]["second_senders"] == []
        assert "own_identifier" not in report["node"]["rejected"]
        assert report["node"]["accepted"] > 0
