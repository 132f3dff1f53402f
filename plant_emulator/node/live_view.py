"""Live view of the plant: its states, its counts, and a line of figures."""

from collections.abc import Mapping

from ...dbc.codec.sender_watch import second_sender_line
from ...dbc.messages import Mode, SteeringCommand
from ...dbc.reception import Reception
from ...runtime.node import View
from ..evaluation.run_record import RunningFigures
from ..network.network import Network
from ..steering.control_unit import SteeringUnit
from ..steering.hold_and_fallback import GuardMode

_MODES: Mapping[GuardMode, str] = {
    GuardMode.NO_COMMAND: "waiting for the first command",
    GuardMode.FOLLOWING: "FOLLOWING the controller's commands",
    GuardMode.HOLDING: "HOLDING the wheel: the controller's commands have stopped",
    GuardMode.FALLBACK: "FALLBACK: no commands for too long, the wheel goes to its fallback angle",
    GuardMode.SAFE_STATE: "SAFE_STATE: no command is followed any more",
}


def plant_view(
    unit: SteeringUnit,
    failure: str,
    reception: Reception,
    network: Network,
    intervention: str,
    command: SteeringCommand | None,
    figures: RunningFigures,
) -> View:
    """Return the view; ``command`` is the one in effect, ``intervention`` the newest in words."""
    states = {
        "mode": _MODES[unit.mode],
        "controller": _controller(command),
        "intervention": intervention,
        "second sender": second_sender_line(reception.second_senders),
        "failure": failure and f"fault of this program: {failure}",
    }
    counts = {
        **{f"frames rejected, {cause}": n for cause, n in reception.rejected.items()},
        **{f"commands limited, {cause}": n for cause, n in unit.interventions.items()},
        "restarts of the controller accepted": reception.resynchronised,
    }
    down_ms, up_ms = (line.latest_latency_ns * 1e-6 for line in (network.downlink, network.uplink))
    now = (
        f"{unit.mode.name}  error {1e3 * figures.lateral_error_final_m:+.1f} mm"
        f"  steer {unit.target_rad:+.3f}  {down_ms:.0f}+{up_ms:.0f} ms"
        f"  rejected {reception.refused}  lost {network.lost}"
    )
    return View(states, counts, now)


def _controller(command: SteeringCommand | None) -> str:
    """Return the mode that the command in effect reports; empty if the controller steers."""
    if command is None or command.mode is Mode.ACTIVE:
        return ""
    return f"the controller reports {command.mode.name}"
