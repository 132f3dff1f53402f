"""Measurements to feed a controller with."""

import math

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import LateralError, encode
from ...runtime.frame import Frame

AMPLITUDE_M, STEP_RAD = 0.01, 0.1


def measurements() -> list[Frame]:
    """Return measurements that can be sent in turn without end: one for each end-to-end counter.

    They oscillate, so that the law has work to do.
    """
    return [
        encode(LateralError(AMPLITUDE_M * math.sin(STEP_RAD * counter), 0.0), counter)
        for counter in range(COUNTERS)
    ]
