"""Hostile clients of the emulated bus, all kinds at once, cost the others no frame."""

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import can
import pytest

from steer_by_wire.closed_loop.processes import Processes
from tests.support.hostile_client import KINDS
from tests.support.running_program import PATIENCE_S

CHANNEL, GOOD_ID = "can0", 0x010
FRAMES = 250
FILTERS = [{"can_id": GOOD_ID, "can_mask": 0x7FF, "extended": False}]


@pytest.mark.skipif(os.name != "posix", reason="Unix sockets are for Unix")
def test_a_frame_of_high_priority_arrives_beside_every_kind_of_hostile_client() -> None:
    with TemporaryDirectory(prefix="hostile-") as name, Processes(Path(name)) as programs:
        programs.start_broker(Path(name) / "socket", [])

        def join() -> can.BusABC:
            return can.Bus(
                interface="emulated",
                channel=CHANNEL,
                address=programs.address,
                can_filters=FILTERS,
                ignore_config=True,
            )

        with join() as sender, join() as receiver:
            for kind in KINDS:
                arguments = [kind, programs.address, CHANNEL]
                programs.start(kind, "tests.support.hostile_client", arguments)
            for number in range(FRAMES):
                data = number.to_bytes(8, "little")
                sender.send(can.Message(arbitration_id=GOOD_ID, data=data, is_extended_id=False))
                received = receiver.recv(PATIENCE_S)
                assert received is not None
                assert received.data == data
            programs.check()
            programs.kill([*KINDS])
        report = programs.stop("broker")
    assert report["channels"][CHANNEL]["load"] > 0.0
    assert report["clients"]["disconnected"]["left"] >= len(("sender", "receiver"))
