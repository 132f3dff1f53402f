"""Deviation of the centre of gravity (CG) from the path, from what the bus carries.

GROUND_TRUTH has it, where the plant sends that. Else it is computed.

LATERAL_ERROR is of the preview point, d ahead of the CG, and so is the curvature of VEHICLE_STATE.
In the frame of the path beside the preview point the CG is at (-d cos Δψ, y - d sin Δψ), and the
path there at d²/2 times its mean curvature on the way back, weighted towards the preview point:

    y_cg = y - d sin Δψ - ρ d²/2        ρ as it was d/3 earlier

Both messages have come through the same uplink. What is left is of the third order: a millimetre
beside the plant's own figure.
"""

import math
from collections import deque

from ..dbc.messages import GroundTruth, LateralError, Message, VehicleState

PREVIEW_M = 2.0
"""Where the wire contract has the preview point, ahead of the CG."""
_KEPT = 4096
"""States kept: at 50 Hz more than a minute, which slow vehicles take for d/3."""


class CgDeviation:
    """Takes the messages of a plant, and returns the deviations that they bring.

    ``preview_m``  d
    """

    def __init__(self, preview_m: float) -> None:
        self._preview_m = preview_m
        self._driven: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._at_s = math.nan
        self._is_sent = False

    def take(self, message: Message, at_s: float) -> float:
        """Take an accepted message, ``at_s`` NaN where there are no times.

        Returns the deviation that it brings [m], to the left positive; NaN for none.
        """
        if isinstance(message, GroundTruth):
            self._is_sent = True
            return message.cg_deviation_m
        if self._is_sent or math.isnan(at_s):
            return math.nan
        if isinstance(message, VehicleState):
            self._drive(message, at_s)
        elif isinstance(message, LateralError) and self._driven:
            return self._computed(message)
        return math.nan

    def _drive(self, state: VehicleState, at_s: float) -> None:
        way_m = self._driven[-1][0] if self._driven else 0.0
        if at_s > self._at_s:
            way_m += state.speed_m_s * (at_s - self._at_s)
        self._at_s = at_s
        self._driven.append((way_m, state.preview_curvature_1_m))

    def _computed(self, error: LateralError) -> float:
        behind_m = self._driven[-1][0] - self._preview_m / 3.0
        while len(self._driven) > 1 and self._driven[1][0] <= behind_m:
            self._driven.popleft()
        curvature_1_m = self._driven[0][1]
        return (
            error.lateral_error_m
            - self._preview_m * math.sin(error.heading_error_rad)
            - 0.5 * self._preview_m * self._preview_m * curvature_1_m
        )
