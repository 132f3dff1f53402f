"""Live view of the controller: a row for each thing worth a line."""

from collections.abc import Mapping

from ...dbc.codec.sender_watch import second_sender_line
from ...dbc.messages import Freshness, Mode, MotionRequest
from ...runtime.node import View
from ..limits.designed_ranges import in_words
from .newest_messages import Received
from .safety_alarms import SafetyFacts

_MODES: Mapping[Mode, str] = {
    Mode.WAITING: "WAITING for the plant's first LATERAL_ERROR",
    Mode.ACTIVE: "ACTIVE: the law steers",
    Mode.HOLDING: "HOLDING the last command: no measurements, no motion forward, or the law failed",
    Mode.SAFE_STOP: "SAFE_STOP: the command ramps to zero",
}
_REQUESTS: Mapping[MotionRequest, str] = {
    MotionRequest.NONE: "",
    MotionRequest.SLOW_DOWN: "asks the vehicle to slow down",
    MotionRequest.STOP: "asks the vehicle to stop",
}
WHEN_LOST = "waiting for it until Ctrl-C (--exit-with-plant ends by itself)"
"""What the controller does by default."""
WHEN_ENDING = "ending when the command is back at zero"
_MESSAGES = ("LATERAL_ERROR", "STEERING_STATUS", "VEHICLE_STATE")


def controller_view(
    mode: Mode,
    failure: str,
    received: Received,
    now_ns: int,
    counts: Mapping[str, int],
    steer_rad: float,
    delay_s: float | None,
    facts: SafetyFacts,
    *,
    ends_with_plant: bool,
) -> View:
    """Return the view.

    ``failure``    the fault with which it cannot steer, empty for none
    ``counts``     what else has happened, without what was received
    ``steer_rad``  the command sent last [rad]
    ``facts``      validity of the settings, and what is asked of the vehicle's drive
    ``delay_s``    from command to measurement, by the echo [s]; None while unknown
    ``ends_with_plant``  whether the program ends when the plant has ended
    """
    reception = received.reception
    states = {
        "mode": _MODES[mode],
        "plant": plant_text(received.freshness(now_ns), ends_with_plant=ends_with_plant),
        "second sender": second_sender_line(reception.second_senders),
        "validity": in_words(facts.validity),
        "request": _REQUESTS[facts.motion_request],
        "failure": failure and f"fault: {failure}",
    }
    events = {
        **{f"frames rejected, {cause}": n for cause, n in reception.rejected.items()},
        "restarts of the plant accepted": reception.resynchronised,
        **counts,
    }
    delay = "unknown" if delay_s is None else f"{1e3 * delay_s:.0f} ms"
    now = (
        f"{mode.name}  error {1e3 * received.lateral_error_m:+.1f} mm  steer {steer_rad:+.3f}"
        f"  delay {delay}  rejected {received.refused}  lost {reception.lost}"
    )
    return View(states, events, now)


def plant_text(freshness: tuple[Freshness, ...], *, ends_with_plant: bool) -> str:
    """Return which messages of the plant have stopped."""
    stale = [name for name, age in zip(_MESSAGES, freshness, strict=True) if age is Freshness.STALE]
    if len(stale) == len(_MESSAGES):
        then = WHEN_ENDING if ends_with_plant else WHEN_LOST
        return f"plant lost: all its messages have stopped; {then}"
    if stale:
        return f"plant: {' and '.join(stale)} stopped"
    return "plant present" if Freshness.FRESH in freshness else ""
