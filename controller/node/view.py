"""Words for what the controller shows of itself while it runs."""

from collections.abc import Mapping

from ...dbc.messages import Freshness, Mode, MotionRequest

MODES: Mapping[Mode, str] = {
    Mode.WAITING: "WAITING for the plant's first LATERAL_ERROR",
    Mode.ACTIVE: "ACTIVE: the law steers",
    Mode.HOLDING: "HOLDING the last command: no measurements, no motion forward, or the law failed",
    Mode.SAFE_STOP: "SAFE_STOP: the command ramps to zero",
}
REQUESTS: Mapping[MotionRequest, str] = {
    MotionRequest.NONE: "",
    MotionRequest.SLOW_DOWN: "asks the vehicle to slow down",
    MotionRequest.STOP: "asks the vehicle to stop",
}
WHEN_LOST = "waiting for it until Ctrl-C (--exit-with-plant ends by itself)"
"""What the controller does by default."""
WHEN_ENDING = "ending when the command is back at zero"
_MESSAGES = ("LATERAL_ERROR", "STEERING_STATUS", "VEHICLE_STATE")


def plant_text(freshness: tuple[Freshness, ...], *, ends_with_plant: bool) -> str:
    """Return which messages of the plant have stopped."""
    stale = [name for name, age in zip(_MESSAGES, freshness, strict=True) if age is Freshness.STALE]
    if len(stale) == len(_MESSAGES):
        then = WHEN_ENDING if ends_with_plant else WHEN_LOST
        return f"plant lost: all its messages have stopped; {then}"
    if stale:
        return f"plant: {' and '.join(stale)} stopped"
    return "plant present" if Freshness.FRESH in freshness else ""


def implausible_text(contradiction: str) -> str:
    """Return the line that says what contradicts what in the plant's signals, else ""."""
    return contradiction and f"warning: signals of the plant: {contradiction}"
