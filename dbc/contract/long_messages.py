"""The two messages with many values, as typed records; both are CAN FD and optional."""

from typing import NamedTuple

from .enumerations import Mode


class SteeringPlan(NamedTuple):
    """Controller to plant, in place of SteeringCommand: commands for the coming time.

    ``plan_number``   the command_counter of its period
    ``first_sample``  E2E counter of the sample of the plant at which ``steer_0_rad`` is to act
    ``spacing``       samples from one value to the next
    """

    plan_number: int
    mode: Mode
    first_sample: int
    spacing: int
    steer_0_rad: float
    steer_1_rad: float
    steer_2_rad: float
    steer_3_rad: float
    steer_4_rad: float
    steer_5_rad: float
    steer_6_rad: float
    steer_7_rad: float
    steer_8_rad: float
    steer_9_rad: float
    steer_10_rad: float
    steer_11_rad: float
    steer_12_rad: float
    steer_13_rad: float
    steer_14_rad: float
    steer_15_rad: float
    steer_16_rad: float
    steer_17_rad: float


class PathAhead(NamedTuple):
    """Plant to controller, optional: curvature of the path over the distance ahead.

    ``path_sample``     E2E counter of the sample with the preview point at ``curvature_0_1_m``
    ``path_spacing_m``  from one value to the next
    """

    path_sample: int
    path_spacing_m: float
    curvature_0_1_m: float
    curvature_1_1_m: float
    curvature_2_1_m: float
    curvature_3_1_m: float
    curvature_4_1_m: float
    curvature_5_1_m: float
    curvature_6_1_m: float
    curvature_7_1_m: float
    curvature_8_1_m: float
    curvature_9_1_m: float
    curvature_10_1_m: float
    curvature_11_1_m: float
    curvature_12_1_m: float
    curvature_13_1_m: float
    curvature_14_1_m: float
    curvature_15_1_m: float
    curvature_16_1_m: float
    curvature_17_1_m: float
    curvature_18_1_m: float
    curvature_19_1_m: float
    curvature_20_1_m: float
    curvature_21_1_m: float
    curvature_22_1_m: float
    curvature_23_1_m: float
    curvature_24_1_m: float
    curvature_25_1_m: float
