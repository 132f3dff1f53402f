"""The values of the signals that are enumerations in the DBC."""

from enum import IntEnum


class Mode(IntEnum):
    """What the controller is doing."""

    WAITING = 0
    """No valid measurement yet; no command is sent."""
    ACTIVE = 1
    HOLDING = 2
    """Measurements stopped: the last command is held."""
    SAFE_STOP = 3
    """Measurements stayed away: the command ramps to zero."""


class LawNumber(IntEnum):
    """Control law."""

    PD = 0
    PD_DOB = 1
    PD_CDOB = 2
    PD_DDOB = 3
    PREDICTOR = 4
    SMITH = 5
    CUSTOM = 7
    """A law from another package."""
    PACKET = 8
    PID = 9
    MPC = 10


class SteeringStatusCode(IntEnum):
    """What the steering actuator does with the command."""

    NO_COMMAND = 0
    APPLYING = 1
    LIMITED = 2
    """Applies it as far as its angle and rate limits allow."""
    LIMITED_BY_SAFETY = 3
    """Applies it as far as the safety limiter allows."""
    HOLDING = 4
    """Commands have stopped: the last one is held."""
    FALLBACK = 5
    """Commands have stopped for longer: the configured fallback is applied."""
    SAFE_STATE = 6
    """The wheel does not follow, or an override: the fallback is applied, and commands ignored."""
    DRIVER_STEERS = 7
    """The angle of the hand wheel is applied, and the command only echoed."""


class SafetyState(IntEnum):
    """A summary of the steering status, including all events since the last PLANT_STATUS."""

    NORMAL = 0
    LIMITING = 1
    """The safety limiter has changed a command."""
    HOLDING = 2
    FALLBACK = 3
    SAFE_STATE = 4


class Freshness(IntEnum):
    """How old the newest accepted frame of a message is."""

    NEVER_SEEN = 0
    FRESH = 1
    STALE = 2
    """Older than its age limit."""


class ControllerFault(IntEnum):
    """A fault with which the controller cannot steer: of itself, or of what it is told."""

    NONE = 0
    OVERRUNS = 1
    """Too many ticks were late."""
    LAW_FAILED = 2
    """The law's output was not finite again after a restart of the law."""
    IMPLAUSIBLE = 3
    """The plant's signals contradict each other."""


class SecondSender(IntEnum):
    """Which node's messages have had a second sender within the last second."""

    NONE = 0
    OWN = 1
    """Messages that the reporting node alone sends."""
    PEER = 2
    """A message that the reporting node receives."""
    BOTH = 3


class Validity(IntEnum):
    """Whether speed, delay and vehicle are what the controller's settings were designed for."""

    UNKNOWN = 0
    """The settings do not state it."""
    VALID = 1
    SPEED_LOW = 2
    SPEED_HIGH = 3
    DELAY_LONG = 4
    MODEL_MISFIT = 5
    """The yaw rate is that of no vehicle of the settings' box."""


class MotionRequest(IntEnum):
    """What the controller asks of the vehicle's drive."""

    NONE = 0
    SLOW_DOWN = 1
    """Speed, delay or vehicle are beyond what its settings were designed for."""
    STOP = 2
    """The vehicle does not go forward, or no one steers."""


class EchoState(IntEnum):
    """Whether the echo of the command counter gives the delay."""

    UNKNOWN = 0
    KNOWN = 1


class ShownMassState(IntEnum):
    """Whether the yaw rate shows the virtual mass."""

    UNKNOWN = 0
    KNOWN = 1


class Direction(IntEnum):
    """The latency line to which a message refers; BOTH is the sum of the two."""

    DOWNLINK = 1
    """Commands, controller to plant."""
    UPLINK = 2
    """Measurements, plant to controller."""
    BOTH = 3


class LatencyModel(IntEnum):
    """Distribution of the latency."""

    CONSTANT = 0
    UNIFORM = 1
    NORMAL = 2
    LOGNORMAL = 3
    GAMMA = 4


class SteeredBy(IntEnum):
    """Who steers the road wheels."""

    LAW = 0
    DRIVER = 1
    BOTH = 2


class Hands(IntEnum):
    """Whether the driver holds the hand wheel."""

    UNKNOWN = 0
    OFF = 1
    ON = 2
