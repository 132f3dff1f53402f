"""Messages on the bus, one typed record for each; ``dbc.messages`` sends and reads them.

Units are SI and the last part of a field's name; signs are ISO 8855 (x forward, y left; left is
positive). What each field means, its range and its resolution are in ``steer_by_wire.dbc``.
"""

import re
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import NamedTuple, TypeAlias, get_args

from .enumerations import (
    ControllerFault,
    Direction,
    EchoState,
    Freshness,
    Hands,
    LatencyModel,
    LawNumber,
    Mode,
    MotionRequest,
    SafetyState,
    SecondSender,
    ShownMassState,
    SteeredBy,
    SteeringStatusCode,
    Validity,
)


class SteeringCommand(NamedTuple):
    """Controller to plant, every control period."""

    steer_rad: float
    command_counter: int
    mode: Mode


class LateralError(NamedTuple):
    """Plant to controller: deviation from the path at the preview point."""

    lateral_error_m: float
    heading_error_rad: float


class SteeringStatus(NamedTuple):
    """Plant to controller: ``applied_counter`` is the command_counter of the command in effect."""

    wheel_angle_rad: float
    applied_counter: int
    status: SteeringStatusCode


class VehicleState(NamedTuple):
    """Plant to controller: motion, and the path's curvature at the preview point."""

    speed_m_s: float
    yaw_rate_rad_s: float
    preview_curvature_1_m: float


class ControllerStatus(NamedTuple):
    """Controller to all, for monitoring; ``skipped_ticks`` is modulo 256."""

    mode: Mode
    law: LawNumber
    disturbance_rad: float
    network_disturbance_rad: float
    skipped_ticks: int


class ControllerSafety(NamedTuple):
    """Controller to all, for monitoring: refused frames, missing messages, and its own faults.

    ``rejected`` and ``lost`` are modulo 4096.
    """

    rejected: int
    lost: int
    lateral_error_freshness: Freshness
    steering_status_freshness: Freshness
    vehicle_state_freshness: Freshness
    fault: ControllerFault
    second_sender: SecondSender = SecondSender.NONE
    validity: Validity = Validity.UNKNOWN
    motion_request: MotionRequest = MotionRequest.NONE


class DelayStatus(NamedTuple):
    """Controller to all, for monitoring: the delay from command to measurement, down and up."""

    echo_delay_s: float
    echo_state: EchoState


class ModelStatus(NamedTuple):
    """Controller to all, optional, for monitoring: the vehicle of the law and of the yaw rate."""

    steering_lag_s: float
    virtual_mass_kg: float
    shown_mass_kg: float
    shown_mass_state: ShownMassState


class PlantStatus(NamedTuple):
    """Plant to all, for monitoring; ``lost`` is modulo 64 and ``rejected`` modulo 32."""

    downlink_latency_s: float
    uplink_latency_s: float
    lost: int
    rejected: int
    safety: SafetyState = SafetyState.NORMAL
    second_sender: SecondSender = SecondSender.NONE


class GroundTruth(NamedTuple):
    """Plant to all, optional, for monitoring: ``cg_deviation_m`` is of the centre of gravity."""

    cg_deviation_m: float


class CarTruth(NamedTuple):
    """Plant to all, optional, for monitoring: what the axles of a car bear and give."""

    front_grip_used: float
    rear_grip_used: float
    front_load_share: float
    lateral_acceleration_m_s2: float


class LatencyConfig(NamedTuple):
    """Any tool to plant: the latency from now on; ``spread_s`` is the standard deviation."""

    direction: Direction
    model: LatencyModel
    mean_s: float
    spread_s: float
    loss: float


class DisturbanceConfig(NamedTuple):
    """Any tool to plant: the disturbances from now on, in place of those of the settings.

    ``friction_loss``  share of both cornering stiffnesses that is missing
    """

    side_force_n: float
    yaw_moment_n_m: float
    steering_offset_rad: float
    friction_loss: float


class SpeedRequest(NamedTuple):
    """Controller to plant, optional: the speed that the vehicle is asked not to exceed."""

    speed_max_m_s: float


class SteeringForce(NamedTuple):
    """Plant to all, optional: the command after the limits, and the force on the rack."""

    limited_command_rad: float
    rack_force_n: float


class SharpPath(NamedTuple):
    """Plant to controller, optional: the preview curvature where VehicleState clamps it."""

    sharp_curvature_1_m: float


class HandWheelState(NamedTuple):
    """Hand wheel to all, optional: its motion and the driver's torque."""

    hand_wheel_angle_rad: float
    hand_wheel_rate_rad_s: float
    driver_torque_n_m: float


class HandWheelFeedback(NamedTuple):
    """Controller to hand wheel, optional: what its motor is to do, and who steers.

    ``answered_state``  E2E counter of the HandWheelState that this answers
    """

    feedback_torque_n_m: float
    steering_ratio: float
    answered_state: int
    steered_by: SteeredBy


class HandWheelStatus(NamedTuple):
    """Hand wheel to all, optional: its state, for supervision and watching."""

    mode: Mode
    hands: Hands
    second_sender: SecondSender
    applied_torque_n_m: float
    rejected: int


class LatencySet(NamedTuple):
    """LatencyConfig with end-to-end protection, for programs."""

    direction: Direction
    model: LatencyModel
    mean_s: float
    spread_s: float
    loss: float


class DisturbanceSet(NamedTuple):
    """DisturbanceConfig with end-to-end protection, for programs."""

    side_force_n: float
    yaw_moment_n_m: float
    steering_offset_rad: float
    friction_loss: float


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


STEER_FIELDS = tuple(name for name in SteeringPlan._fields if name.startswith("steer_"))
"""The fields of SteeringPlan that are angles, in the order in which they act."""
steers_of: Callable[[SteeringPlan], tuple[float, ...]] = attrgetter(*STEER_FIELDS)

CURVATURE_FIELDS = tuple(name for name in PathAhead._fields if name.startswith("curvature_"))
"""The fields of PathAhead that are curvatures, from the preview point on."""
curvatures_of: Callable[[PathAhead], tuple[float, ...]] = attrgetter(*CURVATURE_FIELDS)


Message: TypeAlias = (
    SteeringCommand
    | SteeringPlan
    | SpeedRequest
    | LateralError
    | SteeringStatus
    | SteeringForce
    | VehicleState
    | SharpPath
    | PathAhead
    | HandWheelState
    | HandWheelFeedback
    | ControllerStatus
    | ControllerSafety
    | DelayStatus
    | ModelStatus
    | PlantStatus
    | GroundTruth
    | HandWheelStatus
    | CarTruth
    | LatencyConfig
    | DisturbanceConfig
    | LatencySet
    | DisturbanceSet
)

LatencyChange: TypeAlias = LatencyConfig | LatencySet
DisturbanceChange: TypeAlias = DisturbanceConfig | DisturbanceSet

MESSAGE_TYPES: Mapping[str, type[Message]] = {
    re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind.__name__).upper(): kind for kind in get_args(Message)
}
"""The name of each message in the DBC, and its Python type."""
