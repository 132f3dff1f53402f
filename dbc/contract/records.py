"""What is on the bus, as one typed record for each message; ``dbc.messages`` sends and reads them.

Units are SI and the last part of a field's name; signs are ISO 8855 (x forward, y left; left is
positive). What each field means, its range and its resolution are in ``steer_by_wire.dbc``.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, TypeAlias, get_args

from .enumerations import (
    ControllerFault,
    Direction,
    EchoState,
    EstimateState,
    Freshness,
    LatencyModel,
    LawNumber,
    Mode,
    MotionRequest,
    SafetyState,
    SecondSender,
    SteeringStatusCode,
    Validity,
)
from .long_messages import PathAhead, SteeringPlan


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
    estimated_delay_s: float
    echo_state: EchoState
    estimate_state: EstimateState
    confidence: float


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


Message: TypeAlias = (
    SteeringCommand
    | SteeringPlan
    | LateralError
    | SteeringStatus
    | VehicleState
    | PathAhead
    | ControllerStatus
    | ControllerSafety
    | DelayStatus
    | PlantStatus
    | GroundTruth
    | LatencyConfig
    | DisturbanceConfig
)

MESSAGE_TYPES: Mapping[str, type[Message]] = MappingProxyType(
    {re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind.__name__).upper(): kind for kind in get_args(Message)}
)
"""The name of each message in the DBC, and its Python type."""
