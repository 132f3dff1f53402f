"""How long a frame may wait for the bus at most, whatever else is sent.

    delay(m) ≤ B + n Σ C(k) + (n − 1) C(m) over the messages k of higher priority

    B     the longest frame of lower priority, just begun when m is ready; it is not interrupted
    C(k)  one frame of k, of the greatest length that its stuff bits can give it
    n     how many frames of a message may be ready at once

with the interval to the next frame in each. PLANT_STATUS, sent in between where SAFETY changes, may
follow itself at once and has n + 1; CONTROLLER_SAFETY keeps a control period between two. For n = 1
it is the first step of the response-time analysis of Davis, Burns, Bril and Lukkien, Controller
Area Network (CAN) schedulability analysis: refuted, revisited and revised, Real-Time Systems 35,
2007. It is also the last step as long as the sum is below every period. A program or a bus that
stalls breaks n = 1: frames due a period apart then come at once.
"""

from collections.abc import Collection, Mapping

from ...dbc.messages import CAN_IDS, PlantStatus
from ...runtime.frame_length import INTERMISSION_BITS
from ...runtime.node import NS_PER_S

_AT_CHANGES_TOO = CAN_IDS[PlantStatus]
_PAYLOAD_BYTES = 8
_UNSTUFFED_BITS = 10
"""CRC delimiter, acknowledge and end of frame, which get no stuff bits."""
_STUFFED_BITS = 34
"""From start of frame to the CRC, without the payload, in a frame with 11-bit identifier."""


def longest_frame_ns(bitrate_bit_s: int) -> int:
    """Time of the longest classic frame with 11-bit identifier and its intermission [ns]."""
    stuffed = _STUFFED_BITS + 8 * _PAYLOAD_BYTES
    bits = stuffed + (stuffed - 1) // 4 + _UNSTUFFED_BITS + INTERMISSION_BITS
    return bits * NS_PER_S // bitrate_bit_s


def delay_bounds_ns(
    can_ids: Collection[int], bitrate_bit_s: int, at_once: int = 1
) -> Mapping[int, int]:
    """Return the bound of each of ``can_ids``, which are all that compete above the babbler [ns].

    ``at_once``  frames of one message that may be ready together

    The 11-bit identifiers are of classic frames; the lowest one has the highest priority.
    """
    frame_ns = longest_frame_ns(bitrate_bit_s)
    bounds_ns, frames = {}, 1
    for can_id in sorted(can_ids):
        frames += at_once + (can_id == _AT_CHANGES_TOO)
        bounds_ns[can_id] = (frames - 1) * frame_ns
    return bounds_ns
