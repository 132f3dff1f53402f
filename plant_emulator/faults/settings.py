"""Settings tables `[[faults]]`: faults of frames to and from the plant, and of its steering.

    [[faults]]
    kind = "bit_flips"
    direction = "uplink"
    message = "LATERAL_ERROR"
    onset_s = 3.0
    duration_s = 1.0
    magnitude = 0.01              # of each bit, see the table `MAGNITUDES`

Wire faults change, drop, add or reorder frames, and the receiver's checks can detect them. Signal
faults are those of a sender: the value is wrong, CRC and counter are valid.
``plant_emulator.faults.stage`` applies both, and ``vehicle.car.steering_input`` those of the
steering.
"""

from collections.abc import Collection, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple, Self

from pydantic import Field, ValidationInfo, model_validator

from ...dbc import messages
from ...dbc.messages import MESSAGE_TYPES, Message
from ...runtime.settings import Settings

ALL = "all"
"""Every message of the direction."""
WHOLE_PLAN = "steer_rad"
"""The signal of STEERING_PLAN that stands for each of its angles."""
FAULTS_MAX = 100


class FaultDirection(StrEnum):
    """Direction of the frames, or the steering behind them."""

    DOWNLINK = "downlink"
    """To the plant: commands, and the hand wheel's state."""
    UPLINK = "uplink"
    """From the plant: measurements."""
    STEERING = "steering"
    """None: a fault inside the steering of a car, which no frame shows."""


class FaultKind(StrEnum):
    """Kind of fault."""

    DROP = "drop"
    BURST_LOSS = "burst_loss"
    """A burst starts with one frame in twenty, and may last beyond the fault's end."""
    DUPLICATE = "duplicate"
    REORDER = "reorder"
    """One frame in five is held back."""
    DELAY_SPIKE = "delay_spike"
    FREEZE = "freeze"
    """Each frame is replaced by the last one before the onset."""
    BIT_FLIPS = "bit_flips"
    WRONG_LENGTH = "wrong_length"
    WRONG_IDENTIFIER = "wrong_identifier"
    """Under the identifier of another message of the same sender."""
    SPOOF = "spoof"
    """Each frame is followed by a forged one: next counter, valid CRC, the magnitude as value."""
    REPLAY = "replay"
    """Each frame is replaced by the one recorded this long before."""
    OUT_OF_RANGE = "out_of_range"
    """A raw value outside the signal's range; valid CRC and counter."""
    STUCK = "stuck"
    """The last value before the onset."""
    OFFSET = "offset"
    SCALE = "scale"
    DRIFT = "drift"
    NOISE = "noise"
    WEAK_MOTOR = "weak_motor"
    LOST_CHANNEL = "lost_channel"
    """One of two windings of the motor: half of the current, through twice the resistance."""
    SLOW_WHEEL = "slow_wheel"
    STUCK_WHEEL = "stuck_wheel"
    REVERSED_WHEEL = "reversed_wheel"
    """The steering takes left for right."""
    OFFSET_SENSOR = "offset_sensor"
    DRIFTING_SENSOR = "drifting_sensor"
    """The angle that the sensor reads, and the steering holds, moves away from the wheels."""


class Magnitude(NamedTuple):
    """Meaning of a fault's magnitude, with its unit, and its range."""

    what: str
    minimum: float
    maximum: float
    is_whole: bool = False


_SHARE = "share of frames"
_SIGNAL_UNIT = "in the signal's unit"
_HUGE = 1e6
MAGNITUDES: Mapping[FaultKind, Magnitude] = {
    FaultKind.DROP: Magnitude(_SHARE, 1e-4, 1.0),
    FaultKind.BURST_LOSS: Magnitude("frames in a burst", 1, 1000, True),
    FaultKind.DUPLICATE: Magnitude(_SHARE, 1e-4, 1.0),
    FaultKind.REORDER: Magnitude("frames of its message that overtake", 1, 50, True),
    FaultKind.DELAY_SPIKE: Magnitude("s of further latency", 1e-4, 10.0),
    FaultKind.FREEZE: Magnitude(_SHARE, 1e-4, 1.0),
    FaultKind.BIT_FLIPS: Magnitude("probability that a bit flips", 1e-6, 0.5),
    FaultKind.WRONG_LENGTH: Magnitude("bytes that are left", 0, 7, True),
    FaultKind.WRONG_IDENTIFIER: Magnitude(_SHARE, 1e-4, 1.0),
    FaultKind.SPOOF: Magnitude(_SIGNAL_UNIT, -_HUGE, _HUGE),
    FaultKind.REPLAY: Magnitude("s back", 1e-3, 10.0),
    FaultKind.OUT_OF_RANGE: Magnitude(_SHARE, 1e-4, 1.0),
    FaultKind.STUCK: Magnitude(_SHARE, 1e-4, 1.0),
    FaultKind.OFFSET: Magnitude(_SIGNAL_UNIT, -_HUGE, _HUGE),
    FaultKind.SCALE: Magnitude("factor", -1000.0, 1000.0),
    FaultKind.DRIFT: Magnitude("in the signal's unit per second", -_HUGE, _HUGE),
    FaultKind.NOISE: Magnitude("standard deviation in the signal's unit", 0.0, _HUGE),
    FaultKind.WEAK_MOTOR: Magnitude("share of the torque that is left", 0.0, 1.0),
    FaultKind.LOST_CHANNEL: Magnitude("channels lost, of two", 1, 1, True),
    FaultKind.SLOW_WHEEL: Magnitude("share of the rate that is left", 1e-3, 1.0),
    FaultKind.STUCK_WHEEL: Magnitude("wheels stuck", 1, 1, True),
    FaultKind.REVERSED_WHEEL: Magnitude("wheels reversed", 1, 1, True),
    FaultKind.OFFSET_SENSOR: Magnitude("rad", -1.0, 1.0),
    FaultKind.DRIFTING_SENSOR: Magnitude("rad/s", -1.0, 1.0),
}
SIGNAL_FAULTS = frozenset(
    {
        FaultKind.SPOOF,
        FaultKind.STUCK,
        FaultKind.OFFSET,
        FaultKind.SCALE,
        FaultKind.DRIFT,
        FaultKind.NOISE,
    }
)
"""The kinds that need a signal."""
MOTOR_FAULTS = frozenset({FaultKind.WEAK_MOTOR, FaultKind.LOST_CHANNEL})
STEERING_FAULTS = MOTOR_FAULTS | {
    FaultKind.SLOW_WHEEL,
    FaultKind.STUCK_WHEEL,
    FaultKind.REVERSED_WHEEL,
    FaultKind.OFFSET_SENSOR,
    FaultKind.DRIFTING_SENSOR,
}
"""The kinds inside the steering of a car; those of the motor need `[car.rack]`."""

MESSAGES_OF: Mapping[FaultDirection, tuple[type[Message], ...]] = {
    FaultDirection.DOWNLINK: (*messages.sent_by("CONTROLLER"), messages.HandWheelState),
    FaultDirection.UPLINK: tuple(
        kind
        for kind in messages.sent_by("PLANT")
        if messages.CYCLE_TIMES_MS[kind] or kind is messages.SteeringForce
    ),
}
"""The plant's other optional messages, which have no cycle, arrive without faults."""


class FaultSettings(Settings):
    """One `[[faults]]`."""

    kind: FaultKind
    direction: FaultDirection
    message: str = ALL
    """A message of the DBC, or "all" messages of the direction; in a dialect one of the car's."""
    signal: str | None = None
    """For signal faults: a field of the message, such as ``lateral_error_m``; in a dialect one of
    the car's signals, in its database's unit."""
    onset_s: float = Field(0.0, ge=0.0, le=1e6)
    """After the first command that arrives at the plant, which starts the motion."""
    duration_s: float = Field(1e6, gt=0.0, le=1e6)
    magnitude: float = 1.0
    """Meaning and range depend on the kind."""

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Self:
        what, low, high, is_whole = MAGNITUDES[self.kind]
        if not low <= self.magnitude <= high or (is_whole and self.magnitude % 1.0):
            whole = ", whole" if is_whole else ""
            raise ValueError(
                f"magnitude of {self.kind} ({what}) must be {low:g} to {high:g}{whole},"
                f" not {self.magnitude:g}"
            )
        if self.kind not in SIGNAL_FAULTS and self.signal is not None:
            raise ValueError(f"{self.kind} changes no single signal: leave signal out")
        if (self.direction is FaultDirection.STEERING) != (self.kind in STEERING_FAULTS):
            right = "steering" if self.kind in STEERING_FAULTS else "downlink or uplink"
            raise ValueError(f"direction of {self.kind} must be {right}, not {self.direction}")
        if self.kind in STEERING_FAULTS:
            if self.message != ALL:
                raise ValueError(f"{self.kind} is a fault of no message: leave message out")
            return self
        names: Names = (info.context or {}).get(NAMES, OUR_NAMES)
        names.refuse(self)
        return self


class Names(NamedTuple):
    """What faults can name on a bus.

    ``signals``     of each message that can be changed, by direction and name of the message
    ``impossible``  messages to which a kind cannot happen
    ``whose``       the names are, for error messages
    """

    signals: Mapping[FaultDirection, Mapping[str, Collection[str]]]
    impossible: Mapping[FaultKind, Collection[str]] = MappingProxyType({})
    whose: str = ""

    def messages(self, fault: FaultSettings) -> Collection[str]:
        """Return the messages on which a fault of this kind and direction can act."""
        never = self.impossible.get(fault.kind, ())
        return [name for name in self.signals[fault.direction] if name not in never]

    def refuse(self, fault: FaultSettings) -> None:
        """Raise ValueError if a fault names what it cannot act on."""
        names = self.messages(fault)
        if fault.message not in names and (fault.message != ALL or not names):
            raise ValueError(
                f"message of the {fault.direction} must be {', '.join(names)} or {ALL}"
                f"{self.whose}, not {fault.message!r}"
                if names
                else f"{fault.kind} can happen to no message of the {fault.direction}{self.whose}"
            )
        if fault.kind not in SIGNAL_FAULTS:
            return
        if fault.message == ALL:
            raise ValueError(f"{fault.kind} needs a message, and a signal of it")
        signals = self.signals[fault.direction][fault.message]
        if fault.signal not in signals:
            given = "none" if fault.signal is None else repr(fault.signal)
            raise ValueError(
                f"signal of {fault.message} must be {' or '.join(signals) or 'none'}, not {given}"
            )


def quantities_of(message_type: type[Message]) -> tuple[str, ...]:
    """Return the quantities of a message, which signal faults can change; of a plan, all first."""
    names = tuple(name for name, kind in message_type.__annotations__.items() if kind is float)
    return (WHOLE_PLAN, *names) if message_type is messages.SteeringPlan else names


def fields_of(message_type: type[Message], signal: str) -> tuple[str, ...]:
    """Return the fields of a message that a signal stands for."""
    if message_type is messages.SteeringPlan and signal == WHOLE_PLAN:
        return quantities_of(messages.SteeringPlan)[1:]
    return (signal,) if signal in message_type.__annotations__ else ()


NAMES = "fault_names"
"""Key of the names on the bus, in the context of validation; without it they are ours."""
OUR_NAMES = Names(
    {
        direction: {name: quantities_of(kind) for name, kind in MESSAGE_TYPES.items() if kind in of}
        for direction, of in MESSAGES_OF.items()
    }
)
