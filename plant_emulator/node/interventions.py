"""Interventions: how tools on the bus have changed latency and disturbances during the run.

LATENCY_CONFIG and DISTURBANCE_CONFIG have neither counter nor CRC, LATENCY_SET and
DISTURBANCE_SET have both, and nothing proves who sent any of them. So a plant refuses them
unless its settings allow them, and keeps, prints and reports each one that it takes.

A disturbance takes the place of those of the settings. A friction that no step of the settings has
needs new transition tables. Computing them takes some tens of milliseconds, during which the plant
takes no sample.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from ...dbc.messages import MESSAGE_TYPES, DisturbanceChange, LatencyChange
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ...runtime.settings import SettingsError
from ..settings import PlantSettings
from ..vehicle.car.car_design import under_load
from ..vehicle.car.car_motion import CarMotionParams
from ..vehicle.disturbance import Load, disturbance_interval
from ..vehicle.motion_parameters import transitions, vehicle_params
from ..vehicle.moving_vehicle import AnyMotionParams

KEPT_MAX = 1000
"""How many are kept, the first; all are counted."""
_SENDER = "TOOL"
"""What the identifier claims: the sender that the DBC names for it."""


def refuse_with_key(settings: PlantSettings, has_key: bool) -> None:
    """Raise SettingsError for a plant that is to accept what no key can prove."""
    if has_key and settings.interventions == "allow":
        raise SettingsError(
            "--key-file: a plant with a key accepts no interventions; leave out the key, or"
            " interventions = 'allow' of the plant (its --interventions)"
        )


class Intervention(NamedTuple):
    """One frame that changes the run, ``motion_ns`` after the start of motion, 0 before [ns]."""

    motion_ns: int
    frame: Frame
    message: LatencyChange | DisturbanceChange

    def text(self) -> str:
        """Return it as the user reads it."""
        what = f"{self.frame.can_id:03X}#{self.frame.data.hex().upper()} (sender by DBC: {_SENDER})"
        at = f"at {self.motion_ns / NS_PER_S:.3f} s of motion"
        return f"{in_words(self.message)} {at}, by {what}"

    def report(self) -> Mapping[str, Any]:
        """Return it ready for JSON; ``frame`` as cansend takes it."""
        message = {
            key: value if isinstance(value, float) else value.name.lower()
            for key, value in self.message._asdict().items()
        }
        return {
            "text": self.text(),
            "at_s": self.motion_ns / NS_PER_S,
            "claimed_sender": _SENDER,
            "frame": f"{self.frame.can_id:03X}#{self.frame.data.hex().upper()}",
            "message": _name(self.message),
            **message,
        }


class Interventions:
    """Keeps the interventions of a run.

    ``count``   all that were taken so far; ``newest``: None before the first
    """

    def __init__(self, settings: PlantSettings) -> None:
        self._allows = settings.interventions == "allow"
        self.kept: list[Intervention] = []
        self.count = 0
        self._refused = ""
        """The name of the first that was refused."""
        self.newest: Intervention | None = None

    def admit(
        self, frame: Frame, message: LatencyChange | DisturbanceChange, motion_ns: int
    ) -> bool:
        """Keep one if the settings allow it; returns whether they do."""
        if not self._allows:
            self._refused = self._refused or f"{frame.can_id:03X} ({_name(message)})"
            return False
        self.newest = Intervention(motion_ns, frame, message)
        self.count += 1
        if len(self.kept) < KEPT_MAX:
            self.kept.append(self.newest)
        return True

    def newest_text(self) -> str:
        """Return the newest as one line for the user; empty before the first."""
        if self._refused:
            return f"{self._refused} refused: started without --interventions; more are counted"
        if self.newest is None:
            return ""
        return f"intervention {self.count} over the bus: {self.newest.text()}"

    def report(self) -> Mapping[str, Any]:
        """Return all that is kept, ready for JSON."""
        kept = [each.report() for each in self.kept]
        return {"count": self.count, "kept": kept}


class LiveDisturbances:
    """Turns requests for a disturbance into parameters of the motion of the ``vehicle``."""

    def __init__(self, settings: PlantSettings, params: AnyMotionParams) -> None:
        self.vehicle = vehicle_params(settings.vehicle)
        self._arm_m = settings.disturbance.side_force_arm_m
        self._params = params

    def taken(self, asked: DisturbanceChange) -> AnyMotionParams:
        """Return the parameters of the motion from now on, with the requested disturbance."""
        # Rounded, so that 1 - 0.7 equals a 0.3 in the settings.
        load = Load(*asked[:3], round(1.0 - asked.friction_loss, 6))
        if isinstance(self._params, CarMotionParams):
            loaded = [under_load(x, load, self._arm_m) for x in self._params.intervals]
            self._params = self._params._replace(intervals=loaded)
        else:
            intervals = [disturbance_interval(0, load, self._arm_m, self.vehicle)]
            table, rows = transitions(self.vehicle, self._params.actuator, intervals)
            self._params = self._params._replace(intervals=intervals, table=table, first_rows=rows)
        return self._params


def _name(message: LatencyChange | DisturbanceChange) -> str:
    return next(name for name, kind in MESSAGE_TYPES.items() if kind is type(message))


def in_words(message: LatencyChange | DisturbanceChange) -> str:
    """Return what a message asks for."""
    if isinstance(message, LatencyChange):
        return (
            f"latency {message.direction.name.lower()} {message.model.name.lower()}"
            f" {1e3 * message.mean_s:g} ± {1e3 * message.spread_s:g} ms,"
            f" {100 * message.loss:g} % lost"
        )
    return (
        f"disturbance side force {message.side_force_n:g} N,"
        f" yaw moment {message.yaw_moment_n_m:g} N m,"
        f" steering offset {1e3 * message.steering_offset_rad:g} mrad,"
        f" friction {1.0 - message.friction_loss:g}"
    )
