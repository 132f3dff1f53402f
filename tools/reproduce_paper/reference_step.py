"""A step of the reference on a straight road, which is what (18), y/r, describes.

The nodes have no reference: their path is the reference. So law and vehicle run here without nodes
and frames, in the order of one control period: measure, decide, limit, hold. The reference enters
the PD alone, as in Figure 6. The law is started at rest at the error -r; the observers' filters,
with the double zero of Q/G_n at s = 0, do not respond to it.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from ...controller.design import design_law
from ...controller.law_interface import LawInput
from ...controller.limits import limit_step
from ...controller.settings import ControllerSettings, limits_of
from ...plant_emulator.motion import Motion
from ...plant_emulator.motion_design import motion_params
from ...plant_emulator.rig_settings import StraightSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S


class Step(NamedTuple):
    """Time histories of a step, one row a control period; y - r is the error."""

    time_s: FloatArray
    error_m: FloatArray
    steer_rad: FloatArray


def reference_step(
    plant: PlantSettings,
    controller: ControllerSettings,
    reference_m: float,
    delay_s: float,
    duration_s: float,
) -> Step:
    """Return the response to a reference of ``reference_m`` from time 0 on, on a straight road.

    ``delay_s``  of the command, rounded to whole control periods
    """
    design, limits = design_law(controller), limits_of(controller)
    motion = Motion(motion_params(plant.model_copy(update={"path": StraightSettings()})))
    period_ns = controller.period_ns
    on_their_way = deque([0.0] * round(delay_s * NS_PER_S / period_ns))
    state, steer_rad = design.initial_state(-reference_m), 0.0
    rows = []
    for index in range(round(duration_s * NS_PER_S / period_ns)):
        motion.advance(index * period_ns)
        error_m = motion.lateral_error_m - reference_m
        state, output = design.step(design.params, state, LawInput(error_m, steer_rad))
        steer_rad = limit_step(limits, steer_rad, output.steer_rad)
        on_their_way.append(steer_rad)
        motion.command(on_their_way.popleft())
        rows.append((index * period_ns / NS_PER_S, error_m, steer_rad))
    return Step(*np.array(rows, dtype=np.float64).T)
