"""The frames that an intruder forges; those of a car are in ``forged_car_frames.py``."""

from typing import Protocol

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import (
    CAN_IDS,
    COMMAND_COUNTERS,
    Decoded,
    LateralError,
    Mode,
    SteeringCommand,
    SteeringPlan,
    decode,
    encode,
)
from ...plant_emulator.faults.messages_on_bus import OURS
from ...runtime.frame import Frame


class ForgedFrames(Protocol):
    """Makes frames of a number, each with its checksum and counter."""

    def command(self, steer_rad: float, number: int) -> Frame:
        """Return a command."""
        ...

    def measurement(self, number: int) -> Frame:
        """Return a measurement of 0."""
        ...

    def next_of(self, frame: Frame, steer_rad: float) -> Frame | None:
        """Return the command that would follow a frame; None for a frame that is no command."""
        ...


class OurFrames:
    """Frames of our own messages."""

    def command(self, steer_rad: float, number: int) -> Frame:
        """Return a command."""
        counter = number % COMMAND_COUNTERS
        message = SteeringCommand(steer_rad=steer_rad, command_counter=counter, mode=Mode.ACTIVE)
        return encode(message, number % COUNTERS)

    def measurement(self, number: int) -> Frame:
        """Return a measurement of 0."""
        message = LateralError(lateral_error_m=0.0, heading_error_rad=0.0)
        return encode(message, number % COUNTERS)

    def next_of(self, frame: Frame, steer_rad: float) -> Frame | None:
        """Return the command that would follow a frame; None for neither a command nor a plan."""
        decoded = decode(frame)
        plan = decoded.message if isinstance(decoded, Decoded) else None
        if isinstance(plan, SteeringPlan) and isinstance(decoded, Decoded):
            number = (plan.plan_number + 1) % COMMAND_COUNTERS
            command = SteeringCommand(steer_rad=steer_rad, command_counter=number, mode=plan.mode)
            return encode(command, (decoded.counter + 1) % COUNTERS)
        if frame.can_id != CAN_IDS[SteeringCommand]:
            return None
        return OURS.with_value(frame, "steer_rad", lambda _name, _value: steer_rad, steps=1)
