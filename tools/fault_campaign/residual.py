"""The CRC's residual probability, expected and seen: random corruption that passes as a message.

E2E profile 5 has a CRC of 16 bits: of frames with random errors in more than three bits, one in
65536 has a CRC that fits. A range, a value table or a counter rejects some of these too, so

    accepted ≤ corrupted · 2^-16

is the bound in a run. Only the CRC is judged here, so the figure is tested from both sides.
"""

import random
from typing import NamedTuple

from ...dbc.messages import CAN_IDS, LateralError, Rejection, SteeringCommand, decode, encode
from ...dbc.messages import Mode as ControllerMode
from ...runtime.frame import Frame

RESIDUAL = 2.0**-16
IMPROBABLE = 1e-4
_BITS = 64


class Residual(NamedTuple):
    """Frames corrupted at random, and how many had a CRC that fits."""

    corrupted: int
    fitting: int

    @property
    def expected(self) -> float:
        """How many of them are expected to fit."""
        return self.corrupted * RESIDUAL


def measure_residual(frames: int, seed: int = 1) -> Residual:
    """Put random errors, half of all bits, into ``frames`` frames of both control messages."""
    draw = random.Random(seed)  # noqa: S311 no secret
    command = encode(SteeringCommand(0.05, 77, ControllerMode.ACTIVE), 7)
    error = encode(LateralError(0.02, -0.01), 200)
    words = [int.from_bytes(frame.data, "little") for frame in (command, error)]
    ids = (CAN_IDS[SteeringCommand], CAN_IDS[LateralError])
    fitting = 0
    for number in range(frames):
        which = number & 1
        flips = draw.getrandbits(_BITS) or 1
        judged = decode(Frame(ids[which], (words[which] ^ flips).to_bytes(8, "little")))
        fitting += judged not in (Rejection.BAD_CRC, Rejection.MASQUERADED)
    return Residual(frames, fitting)


def exceeds(accepted: int, corrupted: int) -> bool:
    """Whether too many were accepted for the CRC's residual probability to explain it."""
    from scipy.special import pdtrc

    return accepted > 0 and float(pdtrc(accepted - 1, corrupted * RESIDUAL)) < IMPROBABLE


def falls_short(accepted: int, corrupted: int) -> bool:
    """Whether too few were accepted for the errors to have been random."""
    from scipy.special import pdtr

    return float(pdtr(accepted, corrupted * RESIDUAL)) < IMPROBABLE
