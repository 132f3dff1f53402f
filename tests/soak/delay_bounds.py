"""How long a frame may wait for the bus at most, whatever else is sent.

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
2007. It is also the last step as long as the sum is below every period.
"""

from collections.abc import Collection, Mapping, Sequence

from steer_by_wire.dbc.messages import CAN_IDS, PlantStatus
from steer_by_wire.runtime.bus_model.rest_bus import PeriodicMessage
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.arbitration import arbitration_field
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from steer_by_wire.runtime.frame.longest_frame import longest_frame
from steer_by_wire.runtime.node import NS_PER_S

_WAIT_NS_MAX = NS_PER_S
"""A bound beyond this is none: the bus is overloaded."""
_PAYLOAD_BYTES = 8


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
        frames += at_once + (can_id == CAN_IDS[PlantStatus])
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
