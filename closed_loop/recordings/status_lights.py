"""The lights of a lane: modes, safety states and faults, each with its cause in words."""

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from ...dbc.messages import (
    ControllerFault,
    ControllerSafety,
    ControllerStatus,
    DelayStatus,
    EchoState,
    Freshness,
    Mode,
    PlantStatus,
    SafetyState,
    SteeringStatus,
    SteeringStatusCode,
)
from .live_view import Newest

GOOD, NOTICE, BAD, OFF = "good", "notice", "bad", "off"


class Light(NamedTuple):
    """One light: what it is of, how grave its state is, the state, and the cause in words."""

    name: str
    level: str
    state: str
    cause: str


_MODES = {
    Mode.WAITING: (NOTICE, "no valid measurement yet: no command is sent"),
    Mode.ACTIVE: (GOOD, "steers by fresh measurements"),
    Mode.HOLDING: (NOTICE, "measurements have stopped: the last command is held"),
    Mode.SAFE_STOP: (BAD, "measurements stayed away: the command goes to zero"),
}
_FAULTS = {
    ControllerFault.OVERRUNS: "too many control ticks came too late",
    ControllerFault.LAW_FAILED: "the law gave no finite number, also after a restart",
    ControllerFault.IMPLAUSIBLE: "the plant's signals contradict each other",
}
_STEERING = {
    SteeringStatusCode.NO_COMMAND: (NOTICE, "no command has come yet: the wheel is straight"),
    SteeringStatusCode.APPLYING: (GOOD, "the wheel follows the newest command"),
    SteeringStatusCode.LIMITED: (NOTICE, "the actuator's angle or rate limit binds"),
    SteeringStatusCode.LIMITED_BY_SAFETY: (NOTICE, "the safety limiter has changed the command"),
    SteeringStatusCode.HOLDING: (NOTICE, "commands have stopped: the wheel is held"),
    SteeringStatusCode.FALLBACK: (BAD, "commands stayed away: the wheel goes to its fallback"),
    SteeringStatusCode.SAFE_STATE: (BAD, "a fault or an override: commands are ignored"),
    SteeringStatusCode.DRIVER_STEERS: (GOOD, "the wheels follow the hand wheel"),
}
_SAFETY = {
    SafetyState.NORMAL: (GOOD, "commands pass unchanged"),
    SafetyState.LIMITING: (NOTICE, "a command was limited in the last 0.1 s"),
    SafetyState.HOLDING: (NOTICE, "no command for 140 ms or more: the wheel is held"),
    SafetyState.FALLBACK: (BAD, "silence outlasted the hold: the wheel goes to its fallback"),
    SafetyState.SAFE_STATE: (BAD, "safe state until the plant is started again"),
}
_ECHO = {
    EchoState.UNKNOWN: (NOTICE, "no echo of a command to measure it by"),
    EchoState.KNOWN: (GOOD, "measured by the echo of the command counter"),
}


def lights_of(
    newest: Newest,
    refused: Mapping[str, int],
    late_s: float = 0.0,
    skipped: int = 0,
    names: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Light, ...]:
    """Return the lights of a lane, in the order in which they are shown.

    ``refused``  frames that this program refused in the last seconds, by cause
    ``late_s``   how late this program has read frames in the last seconds; 0: in time
    ``skipped``  control ticks that were skipped in the last seconds
    ``names``    of a car's messages, by the name of ours that they stand for
    """
    steering, plant = newest.of(SteeringStatus), newest.of(PlantStatus)
    safety, delay = newest.of(ControllerSafety), newest.of(DelayStatus)
    status_name = names.get("STEERING_STATUS", "STEERING_STATUS")
    return (
        _controller(newest.of(ControllerStatus), safety),
        _measurements(safety, names),
        _light("Delay", delay and delay.echo_state, _ECHO, "DELAY_STATUS"),
        _light("Steering", steering and steering.status, _STEERING, status_name),
        _light("Safety", plant and plant.safety, _SAFETY, "PLANT_STATUS"),
        _machine(late_s, skipped),
        _refused(refused),
    )


def _light(
    name: str, code: IntEnum | None, words: Mapping[Any, tuple[str, str]], message: str
) -> Light:
    if code is None:
        return Light(name, OFF, "SILENT", f"no {message} on the bus")
    level, cause = words[code]
    return Light(name, level, code.name, cause)


def _controller(status: ControllerStatus | None, safety: ControllerSafety | None) -> Light:
    """Return the mode; a fault that the controller has found in itself comes before it."""
    if safety is not None and safety.fault is not ControllerFault.NONE:
        return Light("Controller", BAD, safety.fault.name, _FAULTS[safety.fault])
    return _light("Controller", status and status.mode, _MODES, "CONTROLLER_STATUS")


def measurements_that_are(
    freshness: Freshness, safety: ControllerSafety, names: Mapping[str, str]
) -> list[str]:
    """Return the names of the measurements that the controller reports with this freshness."""
    of_messages = {
        "LATERAL_ERROR": safety.lateral_error_freshness,
        "STEERING_STATUS": safety.steering_status_freshness,
        "VEHICLE_STATE": safety.vehicle_state_freshness,
    }
    return [names.get(name, name) for name, its in of_messages.items() if its is freshness]


def _measurements(safety: ControllerSafety | None, names: Mapping[str, str]) -> Light:
    if safety is None:
        return Light("Measurements", OFF, "SILENT", "no CONTROLLER_SAFETY on the bus")
    for freshness, level, words in (
        (Freshness.STALE, BAD, "older than its age limit"),
        (Freshness.NEVER_SEEN, NOTICE, "never received by the controller"),
    ):
        if found := measurements_that_are(freshness, safety, names):
            return Light("Measurements", level, freshness.name, f"{', '.join(found)}: {words}")
    return Light("Measurements", GOOD, "FRESH", "all three messages are young enough")


def _machine(late_s: float, skipped: int) -> Light:
    if late_s:
        late = f"frames were read up to {1e3 * late_s:.0f} ms late: no time is measured from them"
        return Light("Machine", BAD, "TOO_SLOW", late)
    if skipped:
        ticks = f"{skipped} control ticks were skipped in the last seconds"
        return Light("Machine", NOTICE, "TOO_SLOW", ticks)
    return Light("Machine", GOOD, "IN_TIME", "frames are read as they come, no tick was skipped")


def _refused(refused: Mapping[str, int]) -> Light:
    if not refused:
        return Light("Frames", GOOD, "INTACT", "none refused in the last seconds")
    causes = ", ".join(cause.replace("_", " ") for cause in refused)
    return Light("Frames", BAD, "REFUSED", f"in the last seconds: {causes}")
