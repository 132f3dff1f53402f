"""The predictor law's settings, and a history of what it has sent and received."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

from steer_by_wire.controller.law_interface import History
from steer_by_wire.controller.settings import ControllerSettings, controller_preset

SENT = [0.1 * tick for tick in range(64)]


def history(
    applied: Callable[[int], int] = lambda sample: sample - 3,
    overruled: Mapping[int, float] = MappingProxyType({}),
) -> History:
    """Return what was sent, applied, and by sample where the wheel was instead."""
    return History(
        63,
        63,
        SENT,
        [0.0] * 64,
        [0.0] * 64,
        [True] * 64,
        [applied(sample) for sample in range(64)],
        [sample in overruled for sample in range(64)],
        [overruled.get(sample, math.nan) for sample in range(64)],
        yaw_rate_sample=[-1] * 64,
    )


def controller(*overrides: str) -> ControllerSettings:
    settings = (
        "law=predictor",
        "predictor.horizon_s_max=1.0",
        "followed_point=preview",
        *overrides,
    )
    return controller_preset("practical_pd_ddob", settings)
