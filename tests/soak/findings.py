"""What a soak must show: its findings, each with its figure.

How long a frame may wait for the bus at most, whatever else is sent:

    delay(m) ≤ B + n Σ C(k) + (n − 1) C(m) + Σ (1 + ⌊delay(m) / T(j)⌋) C(j)

    B     the longest frame of lower priority, just begun when m is ready; it is not interrupted
    C(k)  one frame of k, of the greatest length that its stuff bits can give it; k are the pair's
          messages of higher priority
    n     how many frames of a message may be ready at once
    j     messages of the rest bus of higher priority, one frame each T(j)

with the interval to the next frame in each. PLANT_STATUS, sent in between where SAFETY changes, may
follow itself at once and has n + 1; CONTROLLER_SAFETY keeps a control period between two. For n = 1
it is the first step of the response-time analysis of Davis, Burns, Bril and Lukkien, Controller
Area Network (CAN) schedulability analysis: refuted, revisited and revised, Real-Time Systems 35,
2007. It is also the last step as long as the sum is below every period. A program or a bus that
stalls breaks n = 1: frames due a period apart then come at once.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache

from steer_by_wire.closed_loop.pair_result import CONTROLLER, PLANT
from steer_by_wire.closed_loop.reports.findings import Finding
from steer_by_wire.closed_loop.rest_bus_messages import traffic_of
from steer_by_wire.dbc.messages import CAN_IDS, Mode, PlantStatus
from steer_by_wire.runtime.bus_model.rest_bus import PeriodicMessage
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.arbitration import arbitration_field
from steer_by_wire.runtime.frame.exact_length import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.frame.longest_frame import longest_frame
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.tools.faults.live.live_run import CHANNEL
from tests.soak.frame_balance import MessageBalance
from tests.soak.soak_run import LiveSoak

_AT_CHANGES_TOO = CAN_IDS[PlantStatus]
_WAIT_NS_MAX = NS_PER_S
"""A bound beyond this is none: the bus is overloaded."""
_PAYLOAD_BYTES = 8


@cache
def longest_frame_ns(bitrate_bit_s: int) -> int:
    """Time of the longest classic frame with 11-bit identifier and its intermission [ns]."""
    bits = longest_frame(0, _PAYLOAD_BYTES, 0).bound.nominal + INTERMISSION_BITS
    return bits * NS_PER_S // bitrate_bit_s


def delay_bounds_ns(
    can_ids: Collection[int],
    bitrate_bit_s: int,
    at_once: int = 1,
    traffic: Sequence[PeriodicMessage] = (),
) -> Mapping[int, int]:
    """Return the bound of each of ``can_ids``, the pair's that compete above the babbler [ns].

    ``at_once``  frames of one message that may be ready together
    ``traffic``  messages of the rest bus; together with the pair's they leave the bus some time

    The 11-bit identifiers are of classic frames; the lowest one has the highest priority.
    """
    frame_ns = longest_frame_ns(bitrate_bit_s)
    lengths_ns = [_longest_ns(one, bitrate_bit_s) for one in traffic]
    fields = [arbitration_field(one.frames[0]) for one in traffic]
    longest_ns = max([frame_ns, *lengths_ns])
    bounds_ns, frames = {}, 0
    for can_id in sorted(can_ids):
        frames += at_once + (can_id == _AT_CHANGES_TOO)
        own_ns = longest_ns + (frames - 1) * frame_ns
        above = [
            (one.period_ns, length_ns)
            for one, field, length_ns in zip(traffic, fields, lengths_ns, strict=True)
            if field < arbitration_field(Frame(can_id, b""))
        ]
        before_ns, delay_ns = -1, own_ns
        while before_ns != delay_ns <= _WAIT_NS_MAX:
            before_ns = delay_ns
            delay_ns = own_ns + sum((1 + delay_ns // period) * length for period, length in above)
        bounds_ns[can_id] = delay_ns
    return bounds_ns


def _longest_ns(message: PeriodicMessage, bitrate_bit_s: int) -> int:
    """Return the time of its longest frame with intermission, data phase at the nominal rate."""
    bits = max(sum(frame_bits(frame)) for frame in message.frames) + INTERMISSION_BITS
    return -(-bits * NS_PER_S // bitrate_bit_s)


SEED = 1
"""Of other traffic: the broker's own."""
LOAD_MIN = 0.999
"""Load of a bus that counts as full: a broker that stalls for long leaves gaps."""
PERIOD_S = 0.01
"""The shortest cycle of the pair."""
STARVED_S_MIN = 0.001
"""Time after the onset by which the frame that was on the wire then is complete."""


def load_findings(run: LiveSoak) -> Iterator[Finding]:
    """Yield what is to hold when the babbling node has the lowest priority."""
    load, stall_s = run.bus.load, run.reports["broker"]["lateness"]["max_s"]
    figure = f"load {100 * load:.3f} %; the broker was held up for {1e3 * stall_s:.1f} ms at most"
    yield Finding("bus full", load >= LOAD_MIN, figure)
    yield _room_for_all(run)
    yield _nothing_lost(run)
    yield _nothing_missed(run.messages)
    yield _priority_kept(run)
    modes = [mode for _, mode, _ in run.modes]
    yield Finding("controller in control throughout", modes == ["ACTIVE"], ", ".join(modes))
    yield _recorder_complete(run)
    yield _memory_flat(run)
    yield _nobody_disconnected(run)


def between_findings(run: LiveSoak) -> Iterator[Finding]:
    """Yield what is to hold when the babbling node's priority is between those of the pair."""
    yield _priority_kept(run)
    yield _nothing_above_lost(run)
    yield _handed_over_is_on_bus(run)
    yield _recorder_complete(run)
    yield _nobody_disconnected(run)


def starve_findings(run: LiveSoak) -> Iterator[Finding]:
    """Yield what is to hold when the babbling node has the highest priority."""
    first_ns, last_ns = run.bus.babble_ns
    times_ns = (time_ns for frames in run.bus.control.values() for time_ns, _ in frames)
    through = [t for t in times_ns if first_ns + STARVED_S_MIN * NS_PER_S < t < last_ns]
    ends_s = (last_ns - first_ns) * 1e-9
    figure = f"{len(through)} frames of the pair got through in {ends_s:.2f} s"
    yield Finding("the pair is starved", not through, figure)
    hold_s = next((s for s, mode, _ in run.modes if mode == Mode.HOLDING.name and s > 0.0), None)
    figure = "never" if hold_s is None else f"{1e3 * hold_s:.0f} ms after the onset"
    yield Finding("controller in HOLDING", hold_s is not None and hold_s < ends_s, figure)
    # Its commands cannot show it: by now its queue is full. The report can.
    stopped_s = run.reports[CONTROLLER]["node"]["mode_s"][Mode.SAFE_STOP.name.lower()]
    yield Finding("then in SAFE_STOP", stopped_s > 0.0, f"for {stopped_s:.2f} s")
    guard = run.reports[PLANT]["node"]["safety"]
    figure = f"{guard['fallbacks']}x, {guard['longest_silence_s']:.2f} s without a command"
    yield Finding("plant fallen back", guard["fallbacks"] >= 1, figure)
    back_s = next((s for s, mode, _ in run.modes if mode == Mode.ACTIVE.name and s > ends_s), None)
    figure = "never" if back_s is None else f"{1e3 * (back_s - ends_s):.0f} ms after the end"
    yield Finding("controller in control again", back_s is not None, figure)
    times, ignored = guard["recoveries"], guard["ignored_commands"]
    figure = f"{times}x, {ignored} commands after the silence ignored"
    yield Finding("plant following again", times >= 1, figure)
    yield _handed_over_is_on_bus(run)
    yield _recorder_complete(run)
    yield _nobody_disconnected(run)


def bounds_ns(run: LiveSoak, at_once: int = 1) -> dict[int, int]:
    """Return the bound on the arbitration delay of each message of the pair, by identifier [ns].

    Those below the babbling node have none.
    """
    above = sorted(can_id for can_id in run.bus.control if can_id < min(run.settings.babble_ids))
    traffic = traffic_of(run.settings.bus, SEED)
    return dict(delay_bounds_ns(above, run.settings.bus.bitrate_bit_s, at_once, traffic))


def _room_for_all(run: LiveSoak) -> Finding:
    """While the broker does not run for long, the sockets of the senders fill up."""
    refused = _refused(run)
    return Finding("room for every frame", not refused, f"{refused} frames found no room")


def _nothing_lost(run: LiveSoak) -> Finding:
    """A frame without room was never handed over, but has used up its counter."""
    lost = sum(message.lost for message in run.messages)
    reordered = sum(message.reordered for message in run.messages)
    differ = [message.name for message in run.messages if not message.is_same]
    sent = sum(message.sent for message in run.messages)
    figure = f"{sent} sent, {lost} counters missing on the bus, {reordered} out of order"
    if differ:
        figure += f"; what was sent is not what was on the bus: {', '.join(differ)}"
    holds = lost <= _refused(run) and not (reordered or differ)
    return Finding("no frame of the pair lost or reordered", holds, figure)


def _nothing_above_lost(run: LiveSoak) -> Finding:
    """Except frames without room while the broker did not run, for each message."""
    stall_s = run.reports["broker"]["lateness"]["max_s"]
    above = [message for message in run.messages if message.can_id in bounds_ns(run)]
    figure = ", ".join(f"{message.name} {message.lost}" for message in above)
    holds = all(message.sent and message.lost <= stall_s / PERIOD_S for message in above)
    return Finding("nothing of higher priority lost", holds, figure)


def _refused(run: LiveSoak) -> int:
    return sum(run.reports[name]["loop"]["frames_refused"] for name in (CONTROLLER, PLANT))


def _handed_over_is_on_bus(run: LiveSoak) -> Finding:
    """A frame that a full queue rejected is lost, and its counter with it; no other may be."""
    differ = [message.name for message in run.messages if not message.is_same]
    oldest_s = max(message.waited.max_ns for message in run.messages) * 1e-9
    refused = _refused(run)
    figure = f"{refused} frames found no room; the oldest that was sent had waited {oldest_s:.2f} s"
    if differ:
        figure += f"; not as handed over: {', '.join(differ)}"
    return Finding("what the bus took is sent, in order", not differ, figure)


def _nothing_missed(messages: list[MessageBalance]) -> Finding:
    missed = sum(message.missed for message in messages)
    disordered = sum(message.disordered for message in messages)
    taken = sum(message.taken for message in messages)
    figure = f"{taken} taken, {missed} counters missing, {disordered} out of order"
    left_out = [message.name for message in messages if not message.is_run]
    if left_out:
        figure += f"; what was taken is not what was on the bus: {', '.join(left_out)}"
    beyond = any(message.missed > message.lost for message in messages)
    return Finding("none missed by its receiver", not (beyond or disordered or left_out), figure)


def _priority_kept(run: LiveSoak) -> Finding:
    """99 of 100 frames within the bound, all within that for frames that a stall lets pile up."""
    stall_s = run.reports["broker"]["lateness"]["max_s"]
    for name in (CONTROLLER, PLANT):
        stall_s = max(stall_s, run.reports[name]["loop"]["lateness"]["max_s"])
    # Frames that became due in the stall, and those that become due while they wait.
    at_once = 1 + int((stall_s * NS_PER_S + max(bounds_ns(run).values())) / (PERIOD_S * NS_PER_S))
    p99_beyond = _beyond(run, "p99_s", bounds_ns(run))
    max_beyond = _beyond(run, "max_s", bounds_ns(run))
    stalled_beyond = _beyond(run, "max_s", bounds_ns(run, at_once))
    figure = ", ".join(max_beyond) or "every arbitration within the bound of the bus model"
    if p99_beyond:
        figure = f"99 % beyond the bound: {', '.join(p99_beyond)}"
    elif max_beyond:
        figure += f", after a stall of {1e3 * stall_s:.1f} ms: {at_once} frames may come at once, "
        figure += "beyond which none waited" if not stalled_beyond else "and some waited longer"
    return Finding("priority kept", not (p99_beyond or stalled_beyond), figure)


def _beyond(run: LiveSoak, figure: str, bounds: dict[int, int]) -> list[str]:
    """Name the messages of the pair for which a figure of the delay is beyond its bound."""
    delays = run.reports["broker"]["channels"][CHANNEL]["arbitration_delay"]
    return [
        f"0x{can_id:03X} {1e6 * delays[f'{can_id:03X}'][figure]:.0f} of {bound_ns / 1e3:.0f} us"
        for can_id, bound_ns in bounds.items()
        if delays[f"{can_id:03X}"][figure] * NS_PER_S > bound_ns
    ]


def _recorder_complete(run: LiveSoak) -> Finding:
    bus = run.bus
    channel = run.reports["broker"]["channels"][CHANNEL]
    # The rest bus goes on when the recorder has ended.
    carried = channel["frames"] - channel["traffic"] + bus.others
    holds = (
        bus.frames == carried
        and bus.babbled == run.reports["babbler"]["frames"]
        and not (run.cut_short or bus.unreadable or bus.disordered or bus.babble_missing)
    )
    missing = carried - bus.frames + bus.babble_missing
    figure = f"{bus.frames} of {carried} frames, {missing} missing, {bus.disordered} out of order"
    if run.cut_short:
        figure += f"; ends early: {run.cut_short}"
    return Finding("recorder complete", holds, figure)


def _memory_flat(run: LiveSoak) -> Finding:
    name, worst = max(run.memory.items(), key=lambda item: item[1].growth_kib)
    flat = all(figures.is_flat for figures in run.memory.values())
    return Finding("memory flat", flat, f"at most {worst.growth_kib:+.0f} KiB, {name}")


def _nobody_disconnected(run: LiveSoak) -> Finding:
    gone = run.reports["broker"]["clients"]["disconnected"]
    thrown = {cause: count for cause, count in gone.items() if count and cause != "left"}
    figure = ", ".join(f"{count} {cause}" for cause, count in thrown.items()) or "all left in order"
    return Finding("nobody disconnected", not thrown, figure)
