"""The node in C sends the frames of the node in Python."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.lockstep.record import RECORD_BYTES, START, Record, pack, unpack
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import ControllerSafety, Decoded, DelayStatus, Validity, decode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.tools.generate_c.node_source import commands_in_flight
from tests.support.in_c.law_in_c import hosts, m7
from tests.support.in_c.node_in_c import (
    NODE,
    RecordedNode,
    agree,
    answered,
    built_node,
    drawn_run,
    on_network,
    settings_of,
)
from tests.support.in_c.size_on_m7 import size_on_m7
from tests.support.suite.combinations import sampled

SETTINGS = settings_of("practical_pd_ddob", "overruns.overruns_max=3")
PROMISED = controller_preset("practical_pd_ddob")
JITTERING = {
    "duration_s": 2.0,
    "sensor_noise": {"lateral_error_m": 0.002},
    "latency": {
        "downlink": {"mean_s": 0.05},
        "uplink": {"mean_s": 0.02, "spread_s": 0.01, "model": "normal", "loss": 0.01},
    },
}
LONG_DELAY = {"duration_s": 3.0, "latency": {"downlink": {"mean_s": 0.8}}}
RAM_BYTES_MAX = 16 * 1024


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> Sequence[str]:
    """The words that run a node in C, which every start makes new."""
    return built_node(SETTINGS, tmp_path_factory.mktemp("node"), hosts()[0])


@pytest.mark.parametrize(
    ("place", "wrong"), [(6, (17).to_bytes(2, "little")), (6, b"\xff\xff"), (0, b"LSP2")]
)
def test_a_record_that_is_none_ends_the_program_unread(
    in_c: Sequence[str], place: int, wrong: bytes
) -> None:
    record = bytearray(pack(Record(START, 0)))
    record[place : place + len(wrong)] = wrong
    ended = subprocess.run(in_c, input=bytes(record), stdout=subprocess.PIPE, timeout=60)
    assert (ended.returncode, ended.stdout) == (0, b"")


def through_all(count: int) -> list[RecordedNode]:
    return [drawn_run(SETTINGS, seed) for seed in range(count)]


def test_on_a_network_with_jitter(in_c: Sequence[str]) -> None:
    node = RecordedNode(SETTINGS)
    on_network(node, PlantSettings.model_validate(JITTERING))
    agree(in_c, [node])
    assert node.commands > 150


def test_after_a_bus_was_held_up(in_c: Sequence[str]) -> None:
    """A buffer keeps the first frames, which come at the end."""
    node, uplink = RecordedNode(SETTINGS), {"direction": "uplink", "message": "all"}
    faults = [
        {"kind": "delay_spike", "onset_s": 0.3, "duration_s": 0.02, "magnitude": 0.6, **uplink},
        {"kind": "drop", "onset_s": 0.32, "duration_s": 0.58, "magnitude": 1.0, **uplink},
    ]
    on_network(node, PlantSettings.model_validate({"duration_s": 1.2, "faults": faults}))
    agree(in_c, [node])


def test_through_all_that_happens_to_frames(in_c: Sequence[str]) -> None:
    nodes = through_all(sampled(8, 400))
    agree(in_c, nodes)
    causes = {cause for node in nodes for cause in node.report()["rejected"]}
    assert {"bad_crc", "own_identifier", "no_key", "not_available", "too_far"} <= causes
    assert any(node.report()["failure"] for node in nodes)
    assert any(len(node.report()["second_senders"]) > 1 for node in nodes)


def test_a_cortex_m7_sends_them_too(tmp_path: Path) -> None:
    agree(built_node(SETTINGS, tmp_path / "node", m7("-O2")), through_all(3))


def test_a_delay_longer_than_any_that_is_kept_is_still_too_long(tmp_path: Path) -> None:
    """The node keeps the times of the commands of twice the delay that is promised."""
    node = RecordedNode(PROMISED)
    on_network(node, PlantSettings.model_validate(LONG_DELAY))
    answers = answered(built_node(PROMISED, tmp_path / "node", hosts()[0]), [node])
    records = [unpack(answers[at:][:RECORD_BYTES]) for at in range(0, len(answers), RECORD_BYTES)]
    decoded = [decode(frame) for record in records for _, frame in record.frames]
    sent = [it.message for it in decoded if isinstance(it, Decoded)]
    kept_s = (commands_in_flight(PROMISED) - 1) * PROMISED.period_s
    *_, delay = [it for it in sent if isinstance(it, DelayStatus)]
    *_, safety = [it for it in sent if isinstance(it, ControllerSafety)]
    assert delay.echo_delay_s == pytest.approx(kept_s, abs=PROMISED.period_s)
    assert safety.validity is Validity.DELAY_LONG


def test_it_fits_in_16_kb_of_ram(tmp_path: Path) -> None:
    target, nodes = m7("-O2"), through_all(1)
    built_node(PROMISED, tmp_path / "node", target)
    size = size_on_m7(tmp_path / "node", NODE, b"".join(nodes[0].asked))
    assert 500 < size.stack <= size.stack_bound
    assert size.static + size.stack_bound < RAM_BYTES_MAX
