"""The fault stage at the plant's edge: what each kind does, and that nothing else changes."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.compiled.refusals import NotCompiledError
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import Rejection, SteeringCommand, decode, encode
from steer_by_wire.plant_emulator.faults.effects import EFFECTS
from steer_by_wire.plant_emulator.faults.settings import MAGNITUDES, FaultKind, FaultSettings
from steer_by_wire.plant_emulator.faults.stage import FaultyNode, with_faults
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS, View
from steer_by_wire.runtime.settings import SettingsError, load_settings
from tests.support.frames.decoded_frames import decoded, messages_in
from tests.support.frames.made_messages import command_of

MS = 1_000_000
PERIOD_NS = 10 * MS


class Sink:
    """A node that keeps what reaches it."""

    deadline_ns = NEVER_NS
    finished = False

    def __init__(self) -> None:
        self.came: list[tuple[int, Frame]] = []

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        self.came.append((now_ns, frame))
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        return ()

    def on_unauthenticated(self) -> None: ...

    def view(self, _now_ns: int) -> View:
        return View({}, {}, "")

    def report(self) -> dict[str, Any]:
        return {}


def fault(kind: FaultKind, magnitude: float, **more: Any) -> FaultSettings:
    fields = {"direction": "downlink", "message": "STEERING_COMMAND", "onset_s": 0.1, **more}
    return FaultSettings(kind=kind, magnitude=magnitude, **fields)


def commands(count: int) -> list[Frame]:
    steers_rad = [0.001 * (n % 1000) for n in range(count)]
    return [encode(command_of(steer_rad, n), n % 256) for n, steer_rad in enumerate(steers_rad)]


def passed(*faults: FaultSettings, count: int = 40) -> list[tuple[int, Frame]]:
    """Return what a node behind the faults gets of a command every 10 ms."""
    sink = Sink()
    node = FaultyNode(sink, faults, seed=3)
    for number, frame in enumerate(commands(count)):
        now_ns = number * PERIOD_NS
        while node.deadline_ns < now_ns:
            node.on_tick(node.deadline_ns)
        node.on_frame(frame, now_ns)
    while node.deadline_ns < NEVER_NS:
        node.on_tick(node.deadline_ns)
    return sink.came


def frames(came: Sequence[tuple[int, Frame]]) -> list[Frame]:
    return [frame for _, frame in came]


def steers(came: Sequence[tuple[int, Frame]]) -> list[float]:
    return [message.steer_rad for message in messages_in(frames(came), SteeringCommand)]


def test_before_the_onset_and_after_the_end_nothing_is_changed() -> None:
    for kind in EFFECTS:
        _, low, high, _ = MAGNITUDES[kind]
        signal = {"signal": "steer_rad"} if kind.value in "spoofstuckoffsetscaledriftnoise" else {}
        magnitude = min(max(1.0, low), high)
        came = passed(fault(kind, magnitude, duration_s=0.1, **signal), count=200)
        assert frames(came)[:10] == commands(200)[:10], kind
        assert frames(came)[-50:] == commands(200)[-50:], kind


def test_drop_takes_its_share() -> None:
    assert frames(passed(fault(FaultKind.DROP, 1.0))) == commands(40)[:10]
    left = len(passed(fault(FaultKind.DROP, 0.3, onset_s=0.0), count=2000))
    assert 1300 <= left <= 1500


def test_a_burst_takes_frames_in_a_row() -> None:
    came = frames(passed(fault(FaultKind.BURST_LOSS, 7), count=400))
    numbers = [frame.data[2] for frame in came]
    gaps = {(b - a) % 256 for a, b in pairwise(numbers)}
    assert 8 in gaps
    assert gaps <= {1, *(7 * bursts + 1 for bursts in range(10))}


def test_a_duplicate_follows_its_frame() -> None:
    came = frames(passed(fault(FaultKind.DUPLICATE, 1.0)))
    assert came == commands(10) + [frame for frame in commands(40)[10:] for _ in range(2)]


def test_reordered_frames_come_late_and_none_is_lost() -> None:
    came = frames(passed(fault(FaultKind.REORDER, 3, duration_s=0.2), count=60))
    assert came != commands(60)
    assert sorted(came, key=lambda frame: frame.data[2]) == commands(60)
    places = {frame: place for place, frame in enumerate(came)}
    assert max(places[frame] - place for place, frame in enumerate(commands(60))) >= 3


def test_a_delay_spike_keeps_frames_for_its_time() -> None:
    came = passed(fault(FaultKind.DELAY_SPIKE, 0.055, duration_s=0.05))
    late = [at_ns - frame.data[2] * PERIOD_NS for at_ns, frame in came]
    assert sorted(set(late)) == [0, 55 * MS]
    assert late.count(55 * MS) == 5


def test_a_frozen_sender_repeats_its_last_frame() -> None:
    assert frames(passed(fault(FaultKind.FREEZE, 1.0)))[9:] == [commands(10)[9]] * 31


def test_bits_flip_at_their_rate_and_the_crc_finds_them() -> None:
    sent = commands(1000)
    came = frames(passed(fault(FaultKind.BIT_FLIPS, 0.01, onset_s=0.0), count=1000))
    flipped = sum(
        (int.from_bytes(a.data, "little") ^ int.from_bytes(b.data, "little")).bit_count()
        for a, b in zip(sent, came, strict=True)
    )
    assert 540 <= flipped <= 740  # of 64000 bits, four standard deviations to either side
    refused = {decode(b) for a, b in zip(sent, came, strict=True) if a != b}
    assert refused <= {Rejection.BAD_CRC, Rejection.MASQUERADED}


def test_a_spoofed_command_is_valid_and_one_counter_ahead() -> None:
    came = frames(passed(fault(FaultKind.SPOOF, 0.25, signal="steer_rad")))
    forged = decoded(came[11]).message
    assert isinstance(forged, SteeringCommand)
    assert forged.steer_rad == pytest.approx(0.25)
    assert (came[10], came[11].data[2]) == (commands(11)[10], 11)


def test_a_replay_sends_what_was_sent_so_long_ago() -> None:
    came = frames(passed(fault(FaultKind.REPLAY, 0.05)))
    assert came[10:] == commands(40)[5:35]


def test_signal_faults_are_right_in_all_but_the_value() -> None:
    sent = [0.001 * n for n in range(40)]
    wrong = {
        FaultKind.OFFSET: (0.2, [value + 0.2 for value in sent[10:]]),
        FaultKind.SCALE: (-2.0, [-2.0 * value for value in sent[10:]]),
        FaultKind.DRIFT: (1.0, [value + 0.01 * n for n, value in enumerate(sent[10:])]),
        FaultKind.STUCK: (1.0, [sent[9]] * 30),
    }
    for kind, (magnitude, expected) in wrong.items():
        came = passed(fault(kind, magnitude, signal="steer_rad"))
        assert steers(came) == pytest.approx(sent[:10] + expected, abs=1e-5), kind
        assert [frame.data[2] for frame in frames(came)] == list(range(40))


def test_noise_has_its_standard_deviation() -> None:
    noise = fault(FaultKind.NOISE, 0.1, signal="steer_rad", onset_s=0.0)
    wrong = [a - 0.001 * n for n, a in enumerate(steers(passed(noise, count=500)))]
    assert 0.085 < (sum(value * value for value in wrong) / 500) ** 0.5 < 0.115


def test_a_value_beyond_its_signal_is_sent_as_the_end_of_the_range() -> None:
    came = passed(fault(FaultKind.OFFSET, 1e6, signal="steer_rad"))
    assert steers(came)[-1] == pytest.approx(1.31071)


def test_the_stage_counts_what_it_changed_and_when() -> None:
    node = FaultyNode(Sink(), [fault(FaultKind.DROP, 1.0, duration_s=0.05)], seed=1)
    for number, frame in enumerate(commands(30)):
        node.on_frame(frame, number * PERIOD_NS)
    (reported,) = node.report()["faults"]
    assert (reported["changed"], reported["first_s"], reported["last_s"]) == (5, 0.1, 0.14)


def test_faults_of_other_messages_and_of_none_pass_everything() -> None:
    other = fault(FaultKind.DROP, 1.0, message="CONTROLLER_STATUS", onset_s=0.0)
    assert frames(passed(other)) == commands(40)
    node = PlantNode(PlantSettings(), 0)
    assert with_faults(node, (), 1) is node


def controller_settings() -> ControllerSettings:
    return controller_preset("practical_pd_ddob")


def test_a_run_is_the_same_to_the_last_bit_until_a_fault_begins() -> None:
    jitter = ["duration_s=3", "latency.downlink.model=normal", "latency.downlink.mean_s=0.03"]
    jitter += ["latency.downlink.spread_s=0.01", "sensor_noise.lateral_error_m=0.003"]
    flips = 'faults=[{kind="bit_flips", direction="uplink", onset_s=2.0, magnitude=0.2}]'
    sound, faulty = (
        run_virtual_pair(load_settings(PlantSettings, None, None, settings), controller_settings())
        for settings in (jitter, [*jitter, flips])
    )
    before = sound.trace.time_s < 2.0
    errors_m = (sound.trace.lateral_error_m, faulty.trace.lateral_error_m)
    assert (errors_m[0][before] == errors_m[1][before]).all()
    assert (errors_m[0] != errors_m[1]).any()
    assert faulty.controller["node"]["rejected"]
    assert faulty.plant["node"]["faults"][0]["changed"]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('kind="drop", direction="uplink", magnitude=1.5', "must be 0.0001 to 1, not 1.5"),
        ('kind="wrong_length", direction="uplink", magnitude=2.5', "0 to 7, whole, not 2.5"),
        ('kind="drop", direction="uplink", message="STEERING_COMMAND"', "LATERAL_ERROR, "),
        ('kind="offset", direction="uplink"', "offset needs a message"),
        (
            'kind="offset", direction="uplink", message="LATERAL_ERROR", signal="steer_rad"',
            "signal of LATERAL_ERROR must be lateral_error_m or heading_error_rad",
        ),
        ('kind="drop", direction="uplink", signal="steer_rad"', "leave signal out"),
        ('kind="stuck_wheel", direction="steering", message="X"', "leave message out"),
        ('kind="melt", direction="uplink"', "faults[0].kind"),
        ('kind="drop", direction="uplink", onset_s=-1', "faults[0].onset_s"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_in_one_line(table: str, words: str) -> None:
    with pytest.raises(SettingsError) as error:
        load_settings(PlantSettings, None, None, [f"faults=[{{{table}}}]"])
    assert words in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_compiled_run_refuses_faults_in_one_line() -> None:
    settings = PlantSettings(faults=(fault(FaultKind.DROP, 1.0),))
    with pytest.raises(NotCompiledError, match="compiled runs have none") as error:
        run_compiled(settings, controller_settings())
    assert len(str(error.value).splitlines()) == 1
