"""The pair as real processes on a full bus, judged by what a late machine cannot change.

    SOAK_S=600 python -m pytest tests/soak/test_live_soak.py

runs them for ten minutes, and judges their memory too.
"""

import os

import numpy as np
import pytest

from steer_by_wire.closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM
from steer_by_wire.dbc.messages import CAN_IDS, LateralError, SteeringCommand
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.tools.faults.live.recorded_pair import BROKER, CHANNEL
from tests.soak.babbling_node import GAPS, LOWEST_PRIORITY_IDS
from tests.soak.live_soak import BABBLER, LiveSoak, run_live_soak
from tests.soak.soak_logs import gaps, is_run
from tests.support.suite.combinations import sampled

SOAK_S = float(os.environ.get("SOAK_S", "1"))
PERIOD_S = 0.01
"""The shortest cycle of the pair."""
GROWTH_KIB_MAX = 512
"""Growth over half a run that still counts as flat: the bins of statistics, one at a time, and
pages that an allocator touches late."""


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> LiveSoak:
    """Babbling of the lowest priority, with a rest bus too."""
    folder = tmp_path_factory.mktemp("loaded")
    return run_live_soak(LOWEST_PRIORITY_IDS, SOAK_S, folder, BusSettings(load=0.3))


@pytest.fixture(scope="module")
def between(tmp_path_factory: pytest.TempPathFactory) -> LiveSoak:
    """Babbling that starves all status: 64 of these fill a queue within 2.2 s."""
    return run_live_soak(GAPS[3][:4], 3.0, tmp_path_factory.mktemp("between"))


@pytest.fixture(params=sampled(["loaded"], ["loaded", "between"]))
def live(request: pytest.FixtureRequest) -> LiveSoak:
    run: LiveSoak = request.getfixturevalue(request.param)
    return run


def refused(run: LiveSoak) -> int:
    """Frames that found no room: they were never handed over, but have used up their counters."""
    return sum(
        run.reports[name]["loop"]["frames_refused"] for name in (CONTROLLER_PROGRAM, PLANT_PROGRAM)
    )


def test_the_babbling_node_and_the_pair_were_there(loaded: LiveSoak) -> None:
    assert loaded.bus.babbled > 100
    assert loaded.bus.others > 100
    assert set(loaded.sent) >= {CAN_IDS[SteeringCommand], CAN_IDS[LateralError]}
    assert {
        BROKER,
        BABBLER,
        PLANT_PROGRAM,
        f"{PLANT_PROGRAM}: file writer",
        CONTROLLER_PROGRAM,
    } <= set(loaded.memory_kib)


def test_what_the_bus_took_is_sent_in_order(live: LiveSoak) -> None:
    assert live.sent == live.bus.pair


def test_the_pair_loses_and_reorders_nothing_on_a_full_bus(loaded: LiveSoak) -> None:
    counts = [gaps(frames) for frames in loaded.bus.pair.values()]
    assert sum(lost for lost, _ in counts) <= refused(loaded)
    assert not any(backwards for _, backwards in counts)


def test_a_receiver_misses_nothing_while_it_runs(loaded: LiveSoak) -> None:
    assert loaded.taken
    for can_id, taken in loaded.taken.items():
        assert is_run(taken, loaded.bus.pair[can_id])


def test_a_babbling_node_holds_up_nothing_of_higher_priority(live: LiveSoak) -> None:
    """Except what found no room while the broker did not run, for each message."""
    stall_s = live.reports[BROKER]["lateness"]["max_s"]
    above = [frames for can_id, frames in live.bus.pair.items() if can_id < min(GAPS[3])]
    assert above
    for frames in above:
        lost, _ = gaps(frames)
        assert lost <= stall_s / PERIOD_S


def test_the_recorder_has_every_frame(live: LiveSoak) -> None:
    channel = live.reports[BROKER]["channels"][CHANNEL]
    # The rest bus goes on when the recorder has ended.
    assert live.bus.frames == channel["frames"] - channel["traffic"] + live.bus.others
    assert live.bus.babbled == live.reports[BABBLER]["frames"]
    assert (live.bus.unreadable, live.bus.disordered, live.bus.babble_missing) == (0, 0, 0)
    assert not live.cut_off


def test_nobody_is_disconnected(live: LiveSoak) -> None:
    gone = live.reports[BROKER]["clients"]["disconnected"]
    assert {cause for cause, count in gone.items() if count} <= {"left"}


@pytest.mark.skipif(SOAK_S < 60.0, reason="memory is judged after a minute: SOAK_S=600")
def test_no_process_grows(loaded: LiveSoak) -> None:
    """Buffers grow with the longest stall so far, in steps; a leak in the second half as well."""
    for name, samples in loaded.memory_kib.items():
        times_s, memory_kib = np.array(samples[len(samples) // 2 :]).T
        slope_kib_s = np.polyfit(times_s, memory_kib, 1)[0]
        assert slope_kib_s * (times_s[-1] - times_s[0]) <= GROWTH_KIB_MAX, name
