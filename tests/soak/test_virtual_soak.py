"""What a babbling node does to the pair in virtual time, and the bound on what waits."""

import pytest

from steer_by_wire.controller.node.modes import supervision_of
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, DelayStatus, Mode, PlantStatus, SteeringCommand
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.bus_model.rest_bus import COUNTS, PeriodicMessage
from steer_by_wire.runtime.emulated_bus.transmit_buffers import BUFFER_FULL
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.tools.faults.campaign.babbled_bus import BabbledBus
from steer_by_wire.tools.faults.injection.fault_frames import babble
from tests.soak.babbling_node import GAPS, HIGHEST_PRIORITY_IDS, LOWEST_PRIORITY_IDS
from tests.soak.delay_bounds import delay_bounds_ns, longest_frame_ns
from tests.soak.soak_logs import gaps
from tests.soak.virtual_soak import VirtualSoak, run_virtual_soak
from tests.support.suite.combinations import sampled

BITRATE_BIT_S = 500_000
BABBLE_NS = (2 * NS_PER_S, 8 * NS_PER_S)
END_NS = 10 * NS_PER_S
BETWEEN_NS = (NS_PER_S, 5 * NS_PER_S)
"""Time enough for 120 frames of status, more than one queue for all messages would take."""
COMMAND_ID = CAN_IDS[SteeringCommand]
LOWEST_PRIORITY_ID, HIGHEST_PRIORITY_ID = max(LOWEST_PRIORITY_IDS), min(HIGHEST_PRIORITY_IDS)
CONTROLLER = controller_preset("practical_pd_ddob")


def run(can_id: int) -> VirtualSoak:
    return run_virtual_soak(PlantSettings(), CONTROLLER, can_id, BABBLE_NS, END_NS)


@pytest.fixture(scope="module")
def loaded() -> VirtualSoak:
    return run(LOWEST_PRIORITY_ID)


@pytest.fixture(scope="module")
def starved() -> VirtualSoak:
    return run(HIGHEST_PRIORITY_ID)


# A bus that is full of frames of lower priority


def test_the_bus_is_full(loaded: VirtualSoak) -> None:
    """But for what is cut off at the two ends."""
    frames_cut = 2 * longest_frame_ns(BITRATE_BIT_S) / (BABBLE_NS[1] - BABBLE_NS[0])
    assert 1.0 - frames_cut <= loaded.load <= 1.0 + frames_cut
    assert loaded.babbled > 15_000


def test_the_pair_loses_and_reorders_nothing(loaded: VirtualSoak) -> None:
    assert loaded.refused == 0
    for frames in loaded.on_bus.values():
        assert gaps([frame for _, frame in frames]) == (0, 0)
        times = [time_ns for time_ns, _ in frames]
        assert times == sorted(times)
    assert sum(map(len, loaded.on_bus.values())) == sum(map(len, loaded.delays_ns.values()))
    # Each message as often as in ten seconds without a babbling node.
    assert len(loaded.on_bus[COMMAND_ID]) == pytest.approx(1000, abs=2)
    assert loaded.controller["lost"] == loaded.plant["lost_on_the_bus"] == 0


def test_the_pair_keeps_its_priority(loaded: VirtualSoak) -> None:
    bounds_ns = delay_bounds_ns(list(loaded.on_bus), BITRATE_BIT_S)
    frame_ns = longest_frame_ns(BITRATE_BIT_S)
    for can_id, delays_ns in loaded.delays_ns.items():
        worst_ns = max(delays_ns)
        assert worst_ns <= bounds_ns[can_id]
        # From the other side: it does wait for the babbling node, and for those before it.
        assert worst_ns > 0.8 * bounds_ns[can_id] - frame_ns / 2


def test_the_controller_stays_in_control(loaded: VirtualSoak) -> None:
    assert [mode for _, mode in loaded.modes] == [Mode.ACTIVE]


# A bus that is full of frames of the highest priority


def test_nothing_of_the_pair_gets_through(starved: VirtualSoak) -> None:
    after_ns = BABBLE_NS[0] + longest_frame_ns(BITRATE_BIT_S) * 2
    through = [
        time_ns
        for frames in starved.on_bus.values()
        for time_ns, _ in frames
        if after_ns < time_ns < BABBLE_NS[1]
    ]
    assert through == []
    assert starved.load > 0.999


def test_the_controller_notices_holds_and_stops(starved: VirtualSoak) -> None:
    supervision = CONTROLLER.supervision
    modes = {mode: time_ns for time_ns, mode in reversed(starved.modes)}
    periods_ns = 2 * CONTROLLER.period_ns
    held_after_ns = modes[Mode.HOLDING] - BABBLE_NS[0]
    timeout_ns = supervision_of(CONTROLLER).measurement_timeout_ns
    assert timeout_ns - periods_ns < held_after_ns <= timeout_ns + periods_ns
    stopped_after_ns = modes[Mode.SAFE_STOP] - modes[Mode.HOLDING]
    hold_ns = supervision.hold_ms * NS_PER_MS
    assert hold_ns <= stopped_after_ns <= hold_ns + periods_ns


def test_the_plant_falls_back_once_and_follows_again(starved: VirtualSoak) -> None:
    guard = starved.plant["safety"]
    # What had waited for the bus comes in one burst, behind which the counters are far ahead: a bus
    # that was held up is no second sender, and they are believed at once.
    assert (guard["fallbacks"], guard["recoveries"], guard["safe_state"]) == (1, 1, None)
    babble_s = (BABBLE_NS[1] - BABBLE_NS[0]) / NS_PER_S
    assert babble_s < guard["longest_silence_s"] < babble_s + 0.1


def test_on_a_bus_that_is_only_full_the_plant_never_misses_a_command(loaded: VirtualSoak) -> None:
    guard = loaded.plant["safety"]
    assert (guard["holdings"], guard["fallbacks"], guard["interventions"]) == (0, 0, {})


def test_when_the_babbling_ends_the_controller_is_in_control_again(starved: VirtualSoak) -> None:
    last_ns, last = starved.modes[-1]
    assert last is Mode.ACTIVE
    assert BABBLE_NS[1] < last_ns < BABBLE_NS[1] + 250 * NS_PER_MS


def test_what_waited_for_the_bus_is_bounded(starved: VirtualSoak) -> None:
    for delays_ns in starved.delays_ns.values():
        # What comes afterwards waits until these are sent.
        assert sum(delay_ns > 100 * NS_PER_MS for delay_ns in delays_ns) == BUFFER_FULL
    assert starved.refused > 0


# A bus that is full of frames of a priority between the pair's own


def test_the_gaps_hold_every_identifier_between_the_pairs_own() -> None:
    own = set(CAN_IDS.values()) - {0x320, 0x324}
    between = {can_id for gap in GAPS for can_id in gap}
    assert between == set(range(min(own), max(own))) - own


@pytest.mark.parametrize("can_id", [gap[0] for gap in sampled(GAPS[3:4], GAPS)])
def test_what_is_starved_does_not_hold_up_what_has_a_higher_priority(can_id: int) -> None:
    soak = run_virtual_soak(PlantSettings(), CONTROLLER, can_id, BETWEEN_NS, BETWEEN_NS[1])
    above = [own for own in soak.delays_ns if own < can_id]
    assert COMMAND_ID in above
    bounds_ns = delay_bounds_ns(above, BITRATE_BIT_S)
    for own in above:
        assert max(soak.delays_ns[own]) <= bounds_ns[own]
        assert gaps([frame for _, frame in soak.on_bus[own]]) == (0, 0)
    commands = BETWEEN_NS[1] // CONTROLLER.period_ns
    assert len(soak.on_bus[COMMAND_ID]) == pytest.approx(commands, abs=2)
    starved = [own for own in CAN_IDS.values() if own > can_id]
    assert not any(
        BETWEEN_NS[0] + NS_PER_MS < time_ns
        for own in starved
        for time_ns, _ in soak.on_bus.get(own, ())
    )


def test_a_starved_message_is_refused_when_its_transmit_buffer_is_full() -> None:
    end_ns = 10 * NS_PER_S
    soak = run_virtual_soak(PlantSettings(), CONTROLLER, 0x305, (NS_PER_S, 9 * NS_PER_S), end_ns)
    starved = [soak.on_bus[CAN_IDS[message]] for message in (DelayStatus, PlantStatus)]
    losses = [gaps([frame for _, frame in frames]) for frames in starved]
    assert [reordered for _, reordered in losses] == [0, 0]
    assert losses[0][0] == pytest.approx(80 - BUFFER_FULL, abs=2)
    assert sum(lost for lost, _ in losses) == soak.refused


# The babbling node itself


@pytest.mark.parametrize("can_id", [LOWEST_PRIORITY_ID, HIGHEST_PRIORITY_ID])
def test_a_babbling_node_leaves_the_bus_not_one_bit(can_id: int) -> None:
    model = BusModel(BITRATE_BIT_S)
    bus = BabbledBus(model, can_id, 1000, 50 * NS_PER_MS)
    while bus.next_event_ns < 100 * NS_PER_MS:
        assert bus.advance(bus.next_event_ns) == []
    bits = sum(
        frame_bits(babble(can_id, number)).nominal + INTERMISSION_BITS
        for number in range(bus.babbled)
    )
    assert model.load.busy_ns == bits * NS_PER_S // BITRATE_BIT_S
    assert model.load.busy_ns >= 50 * NS_PER_MS - 1000
    assert bus.babbled > 150


# The bound


def test_each_message_waits_for_one_frame_and_for_those_before_it() -> None:
    bounds_ns = delay_bounds_ns([0x300, 0x100, 0x110], BITRATE_BIT_S)
    assert bounds_ns == {0x100: 270_000, 0x110: 540_000, 0x300: 810_000}
    # One that comes with a second one waits for the first, too.
    bounds_ns = delay_bounds_ns([0x300, 0x100, 0x110], BITRATE_BIT_S, at_once=2)
    assert bounds_ns == {0x100: 540_000, 0x110: 1_080_000, 0x300: 1_620_000}
    # PLANT_STATUS is sent in between, too, and may wait for itself.
    bounds_ns = delay_bounds_ns([0x310, 0x100], BITRATE_BIT_S)
    assert bounds_ns == {0x100: 270_000, 0x310: 810_000}


def test_other_peoples_messages_of_higher_priority_count_as_often_as_they_come() -> None:
    often = PeriodicMessage("A", -1, (Frame(0x50, bytes(8)),) * COUNTS, 400_000)
    below = often._replace(name="B", frames=(Frame(0x7F0, bytes(8)),) * COUNTS)
    length_ns = (frame_bits(often.frames[0]).nominal + INTERMISSION_BITS) * 2000
    bounds_ns = delay_bounds_ns([0x100, 0x110], BITRATE_BIT_S, traffic=[often, below])
    # The second frame comes 400 us after the first, and the third at the end of the second wait.
    assert bounds_ns[0x100] == 270_000 + 2 * length_ns
    assert 400_000 <= bounds_ns[0x100] < 800_000
