"""Words for what the plant shows of itself while it runs."""

from collections.abc import Mapping

from ...dbc.messages import Mode, SteeringCommand
from ..steering.hold_and_fallback import GuardMode

MODES: Mapping[GuardMode, str] = {
    GuardMode.NO_COMMAND: "waiting for the first command",
    GuardMode.FOLLOWING: "FOLLOWING the controller's commands",
    GuardMode.HOLDING: "HOLDING the wheel: the controller's commands have stopped",
    GuardMode.FALLBACK: "FALLBACK: no commands for too long, the wheel goes to its fallback angle",
    GuardMode.SAFE_STATE: "SAFE_STATE: no command is followed any more",
}


def controller_text(command: SteeringCommand | None) -> str:
    """Return the mode that the command in effect reports; empty if the controller steers."""
    if command is None or command.mode is Mode.ACTIVE:
        return ""
    return f"the controller reports {command.mode.name}"
