"""The two ends of an authenticated link, with their key, and frames of both."""

from steer_by_wire.dbc.messages import (
    ControllerStatus,
    HandWheelState,
    HandWheelStatus,
    LateralError,
    Mode,
    PlantStatus,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from steer_by_wire.dbc.secoc.authentication import Authentication
from steer_by_wire.dbc.secoc.key_file import cmac_maker
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import command_of, message_with, motion_of

KEY = bytes(range(16))
CONTROLLER_CHALLENGE, PLANT_CHALLENGE = b"ctrl-one", b"plantone"
CONTROLLER_STATUS = encode(message_with(ControllerStatus, mode=Mode.ACTIVE, skipped_ticks=3), 7)
PLANT_STATUS = encode(
    message_with(PlantStatus, downlink_latency_s=0.08, uplink_latency_s=0.02, lost=1, rejected=2), 9
)
FROM_PLANT = (
    encode(message_with(LateralError, lateral_error_m=0.125, heading_error_rad=-0.01), 1),
    encode(
        message_with(
            SteeringStatus,
            wheel_angle_rad=0.1,
            applied_counter=77,
            status=SteeringStatusCode.APPLYING,
        ),
        2,
    ),
    encode(motion_of(1.4, 0.01, 0.02), 3),
)
HAND_WHEEL_STATE = encode(message_with(HandWheelState, hand_wheel_angle_rad=0.3), 5)
HAND_WHEEL_STATUS = encode(message_with(HandWheelStatus, mode=Mode.ACTIVE), 6)
COMMAND = encode(command_of(0.25, 7), 200)


def controller(
    key: bytes = KEY, challenge: bytes = CONTROLLER_CHALLENGE, first_counter: int = 0
) -> Authentication:
    return Authentication(("PLANT",), cmac_maker()(key), challenge, first_counter)


def plant(
    key: bytes = KEY, challenge: bytes = PLANT_CHALLENGE, first_counter: int = 0
) -> Authentication:
    return Authentication(("CONTROLLER",), cmac_maker()(key), challenge, first_counter)


def meet(controller_end: Authentication, plant_end: Authentication) -> None:
    """Exchange status messages until both ends are synchronised: one and a half round trips."""
    plant_end.verify(controller_end.secure(CONTROLLER_STATUS))
    controller_end.verify(plant_end.secure(PLANT_STATUS))
    plant_end.verify(controller_end.secure(CONTROLLER_STATUS))
    assert controller_end.is_synchronised
    assert plant_end.is_synchronised


def met(first_counter: int = 0) -> tuple[Authentication, Authentication]:
    ends = controller(first_counter=first_counter), plant(first_counter=first_counter)
    meet(*ends)
    return ends


def flipped(frame: Frame, bit: int) -> Frame:
    number = int.from_bytes(frame.data, "big") ^ 1 << bit
    return frame._replace(data=number.to_bytes(len(frame.data), "big"))
