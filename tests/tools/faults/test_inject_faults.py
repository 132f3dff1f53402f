"""The live injector: what it is asked for; what it sends and when is seeded and repeatable."""

from itertools import islice, pairwise
from pathlib import Path

import pytest

from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.overheard import listening_to
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    LateralError,
    SteeringCommand,
    decode,
    encode,
)
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_S
from steer_by_wire.tools.faults import __main__ as inject_faults
from steer_by_wire.tools.faults.fault_frames import (
    FRAMES_AT_ONCE,
    FrameSource,
    frame_source,
)
from steer_by_wire.tools.faults.forged_car_frames import CarFrames
from steer_by_wire.tools.faults.forged_frames import ForgedFrames, OurFrames
from steer_by_wire.tools.faults.live_faults import (
    MAGNITUDES,
    LiveFault,
    LiveKind,
    list_lines,
    parse_fault,
)
from tests.support.frames.made_messages import command_of, plan_of

BITRATE_BIT_S = 500_000
START_NS = 7_000_000_000
COMMAND_ID = CAN_IDS[SteeringCommand]


def source_of(text: str, seed: int = 1, forged: ForgedFrames | None = None) -> FrameSource:
    return frame_source(parse_fault(text), START_NS, seed, BITRATE_BIT_S, forged or OurFrames())


def sent(source: FrameSource, step_ns: int = 1_000_000) -> list[tuple[int, Frame]]:
    """Ask a source every ``step_ns`` until it has nothing more."""
    frames = []
    now_ns = START_NS
    while source.next_due_ns != NEVER_NS and now_ns < source.end_ns:
        frames += [(now_ns, frame) for frame in source.due(now_ns)]
        now_ns += step_ns
    return frames


# What is asked for


def test_a_fault_is_its_kind_and_what_is_said_of_it() -> None:
    assert parse_fault("spoof") == LiveFault(LiveKind.SPOOF, 0.0, 1.0, 0.5)
    assert parse_fault("spoof,onset_s=2,magnitude=-0.1,duration_s=3").end_s == 5.0


@pytest.mark.parametrize("kind", sorted(MAGNITUDES))
def test_a_magnitude_is_taken_at_the_ends_of_its_range_and_not_beyond(kind: LiveKind) -> None:
    what, low, high, default = MAGNITUDES[kind]
    assert parse_fault(kind).magnitude == default
    for good in (low, high):
        assert parse_fault(f"{kind},magnitude={good!r}").magnitude == good
    for bad in (low - 1e-6, high + 1e-6):
        with pytest.raises(ValueError, match=f"{kind}: magnitude .* must be") as error:
            parse_fault(f"{kind},magnitude={bad!r}")
        assert what in str(error.value)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "'': no such fault; there are babble, "),
        ("spoof_nxt", "'spoof_nxt': no such fault .did you mean spoof_next.*; there are babble, "),
        ("spoof,seed=3", "spoof: 'seed=3' is not KEY=VALUE with a key of onset_s, duration_s"),
        ("spoof,onset_s", "spoof: 'onset_s' is not KEY=VALUE"),
        ("spoof,onset_s=1,onset_s=2", "spoof: onset_s is given twice"),
        ("spoof,onset_s=nan", "spoof: onset_s must be 0 to 100000, not 'nan'"),
        ("noise,to=plant", "noise: 'to=plant' is not KEY=VALUE"),
    ],
)
def test_a_mistake_in_a_fault_is_one_clear_line(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint) as error:
        parse_fault(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "give 1 to 100 faults, not 0"),
        (["babble"] * 101, "give 1 to 100 faults, not 101"),
        (["jam"], "no such fault"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_clear_line(
    words: list[str],
    complaint: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert inject_faults.main(words) == 2
    printed = capsys.readouterr()
    assert complaint in printed.err
    assert printed.err.count("\n") == 1
    assert "ready" not in printed.out


def test_a_number_out_of_range_is_reported_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        inject_faults.main(["spoof", "--seed", "-1"])
    expected = "argument --seed: allowed is 0 to 4294967296, not '-1'"
    assert expected in capsys.readouterr().err


def test_the_list_has_every_kind_with_its_range(capsys: pytest.CaptureFixture[str]) -> None:
    assert inject_faults.main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == list_lines()
    assert [line.split()[0] for line in lines] == list(LiveKind)


# What is sent


@pytest.mark.parametrize("kind", sorted(MAGNITUDES))
def test_the_same_seed_sends_the_same_frames_at_the_same_times(kind: LiveKind) -> None:
    text = f"{kind},onset_s=0.02,duration_s=0.1"
    first, again = (sent(source_of(text, 5)) for _ in range(2))
    assert first == again
    if kind is not LiveKind.SPOOF_NEXT:
        assert first
        assert first[0][0] == START_NS + 20_000_000
        assert first[-1][0] < START_NS + 120_000_000
    if kind in (LiveKind.SPOOF, LiveKind.NOISE):
        assert sent(source_of(text, 6)) != first


def test_a_spoofed_command_is_a_valid_one_with_a_counter_of_its_own() -> None:
    frames = [decode(frame) for _, frame in sent(source_of("spoof,magnitude=0.3"))]
    assert len(frames) == 100
    counters = []
    for decoded in frames:
        assert isinstance(decoded, Decoded)
        assert isinstance(decoded.message, SteeringCommand)
        assert decoded.message.steer_rad == pytest.approx(0.3)
        counters.append(decoded.counter)
    steps = {(after - before) % 256 for before, after in pairwise(counters)}
    assert steps == {1}


def test_who_listens_forges_the_next_command_and_only_while_it_is_time() -> None:
    source = source_of("spoof_next,onset_s=1,magnitude=-0.2")
    true = encode(command_of(0.1, 300), 255)
    onset_ns = START_NS + NS_PER_S
    assert source.on_frame(true, onset_ns - 1) == ()
    assert source.on_frame(true, onset_ns + NS_PER_S) == ()
    (forged,) = source.on_frame(true, onset_ns)
    decoded = decode(forged)
    assert isinstance(decoded, Decoded)
    assert isinstance(decoded.message, SteeringCommand)
    assert decoded.counter == 0
    assert decoded.message.steer_rad == pytest.approx(-0.2)
    assert source.on_frame(Frame(0x111, true.data), onset_ns) == ()
    assert source.on_frame(true._replace(data=bytes(8)), onset_ns) == ()


def test_half_of_the_noise_comes_where_somebody_listens() -> None:
    ids = [frame.can_id for _, frame in sent(source_of("noise,magnitude=2000,duration_s=2"))]
    heard = sum(can_id in (COMMAND_ID, CAN_IDS[LateralError]) for can_id in ids)
    assert 0.45 < heard / len(ids) < 0.55
    assert max(ids) > 0x700


def test_a_node_that_babbles_takes_the_share_of_the_bus_it_is_reported() -> None:
    frames = [frame for _, frame in sent(source_of("babble,magnitude=0.25"))]
    assert {frame.can_id for frame in frames} == {0}
    bits = sum(frame_bits(frame).nominal + INTERMISSION_BITS for frame in frames)
    assert bits / BITRATE_BIT_S == pytest.approx(0.25, rel=0.1)  # stuff bits differ


def test_a_node_that_babbles_at_full_load_always_has_a_frame_ready() -> None:
    source = source_of("babble")
    assert len(list(source.due(START_NS))) == FRAMES_AT_ONCE
    assert source.next_due_ns <= START_NS
    assert len(list(islice(source.due(START_NS + 1), 3))) == 3
    assert not list(source.due(START_NS + NS_PER_S))


# In the messages of a car


CAR = Path(__file__).parents[2] / "dbc" / "dialect" / "my_car.toml"


def test_a_car_is_attacked_in_its_own_frames() -> None:
    dialect = read_dialect(CAR)
    overheard = listening_to(dialect)
    for now_ns, frame in sent(source_of("spoof,magnitude=0.1", forged=CarFrames(dialect))):
        assert frame.can_id == 0x100
        overheard.hear(frame, now_ns)
    assert overheard.counts("STEER_REQUEST") == (100, 0, 0, {})


def test_the_next_frame_of_a_car_is_forged() -> None:
    dialect = read_dialect(CAR)
    forged, overheard = CarFrames(dialect), listening_to(dialect)
    source = source_of("spoof_next,magnitude=0.001", forged=forged)
    true_one, next_one = forged.command(0.0, 15), forged.command(0.0, 16)
    (follower,) = source.on_frame(true_one, START_NS)
    for frame in (true_one, follower, next_one):
        overheard.hear(frame, START_NS)
    assert overheard.counts("STEER_REQUEST") == (2, 0, 0, {"repeated counter": 1})
    assert source.on_frame(forged.measurement(0), START_NS) == ()


def test_the_next_of_a_plan_is_a_command() -> None:
    plan = encode(plan_of([0.1] * 18, plan_number=65_535, first_sample=7, spacing=2), 255)
    following = OurFrames().next_of(plan, 0.25)
    assert following is not None
    assert decode(following) == Decoded(command_of(0.25), 0)
