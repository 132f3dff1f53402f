"""Interventions: what LATENCY_CONFIG and DISTURBANCE_CONFIG on the bus have changed of the run.

These frames have neither counter nor CRC, and nothing proves who sent them. So each one is kept,
printed and reported, with the settings that repeat the run without the tool.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ...dbc.messages import Direction, DisturbanceConfig, LatencyConfig
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ..network.latency_distributions import Distribution
from ..network.settings import LatencySettings
from ..settings import PlantSettings

FRICTIONS_MAX = 16
"""How many the settings take; half of them may be the settings' own."""
KEPT_MAX = 1000
"""How many are kept, the first; all are counted."""
_SENDER = "TOOL"
"""What the identifier claims: the sender that the DBC names for it."""


class Intervention(NamedTuple):
    """One frame that changes the run, or would if the settings allowed it.

    ``motion_ns``  time since the start of motion, 0 before [ns]
    ``is_taken``   whether it acts
    """

    motion_ns: int
    is_taken: bool
    frame: Frame
    message: LatencyConfig | DisturbanceConfig

    def text(self) -> str:
        """Return it as the user reads it."""
        what = f"{self.frame.can_id:03X}#{self.frame.data.hex().upper()} (sender by DBC: {_SENDER})"
        at = f"at {self.motion_ns / NS_PER_S:.3f} s of motion"
        return f"{in_words(self.message)} {at}{'' if self.is_taken else ', REFUSED'}, by {what}"

    def report(self) -> Mapping[str, Any]:
        """Return it ready for JSON; ``frame`` as cansend takes it."""
        message = {
            key: value if isinstance(value, float) else value.name.lower()
            for key, value in self.message._asdict().items()
        }
        return {
            "text": self.text(),
            "at_s": self.motion_ns / NS_PER_S,
            "taken": self.is_taken,
            "claimed_sender": _SENDER,
            "frame": f"{self.frame.can_id:03X}#{self.frame.data.hex().upper()}",
            "message": "LATENCY_CONFIG"
            if isinstance(self.message, LatencyConfig)
            else "DISTURBANCE_CONFIG",
            **message,
        }


class Interventions:
    """Keeps the interventions of a run.

    ``count``   all so far, and ``refused``, those among them that the settings do not allow
    ``newest``  None before the first
    """

    def __init__(self, settings: PlantSettings) -> None:
        self._settings = settings
        self.kept: list[Intervention] = []
        self.count = self.refused = 0
        self.newest: Intervention | None = None

    def take(
        self, frame: Frame, message: LatencyConfig | DisturbanceConfig, motion_ns: int
    ) -> bool:
        """Keep one; returns whether the settings allow it."""
        is_taken = self._settings.interventions == "allow"
        self.newest = Intervention(motion_ns, is_taken, frame, message)
        self.count += 1
        self.refused += not is_taken
        if len(self.kept) < KEPT_MAX:
            self.kept.append(self.newest)
        return is_taken

    def newest_text(self) -> str:
        """Return the newest as one line for the user; empty before the first."""
        if self.newest is None:
            return ""
        return f"intervention {self.count} over the bus: {self.newest.text()}"

    def marks(self) -> Sequence[tuple[float, str]]:
        """Return the times of motion [s] of all that is kept, and what they are in words."""
        return [(each.motion_ns / NS_PER_S, each.text()) for each in self.kept]

    def report(self) -> Mapping[str, Any]:
        """Return all that is kept, ready for JSON.

        ``repeat_with``  settings, each for ``--set``, that repeat the run; None if none can, and
                         ``repeat_obstacle``, why
        """
        overrides, obstacle = self._repeating()
        return {
            "count": self.count,
            "refused": self.refused,
            "kept": [each.report() for each in self.kept],
            "repeat_with": None if obstacle else overrides,
            "repeat_obstacle": obstacle,
        }

    def _repeating(self) -> tuple[list[str], str]:
        taken = [each for each in self.kept if each.is_taken]
        if self.count > KEPT_MAX:
            return [], f"only the first {KEPT_MAX} interventions are kept"
        loads = [
            (each.motion_ns, each.message)
            for each in taken
            if isinstance(each.message, DisturbanceConfig)
        ]
        overrides = []
        if loads:
            if self._settings.disturbance.model is not None:
                return [], "the disturbance is that of a plug-in"
            if len({load.friction_loss for _, load in loads}) > FRICTIONS_MAX // 2:
                return [], "more values of friction than the settings take"
            overrides.append(f"disturbance.steps={self._steps(loads)}")
        for direction, own in (
            (Direction.DOWNLINK, self._settings.latency.downlink),
            (Direction.UPLINK, self._settings.latency.uplink),
        ):
            changes = [
                (each.motion_ns, each.message)
                for each in taken
                if isinstance(each.message, LatencyConfig)
                and each.message.direction in (direction, Direction.BOTH)
            ]
            if changes:
                model = _one_model(own, [config for _, config in changes])
                if model is None:
                    return [], "one schedule of latencies has one model and shape; these differ"
                table = f"latency.{direction.name.lower()}"
                overrides += [
                    f'{table}.model="{model}"',
                    f"{table}.schedule={_schedule(own, changes)}",
                ]
        return overrides, ""

    def _steps(self, loads: Sequence[tuple[int, DisturbanceConfig]]) -> str:
        """Return [[disturbance.steps]]: those of the settings up to the first request, then it."""
        first_s = loads[0][0] / NS_PER_S
        rows = {
            step.at_s: step.model_dump(exclude_none=True)
            for step in self._settings.disturbance.steps
            if step.at_s < first_s
        }
        for motion_ns, config in loads:
            values = config._asdict()
            friction = round(1.0 - values.pop("friction_loss"), 6)
            rows[motion_ns / NS_PER_S] = {
                "at_s": motion_ns / NS_PER_S,
                **values,
                "friction": friction,
            }
        return _toml(list(rows.values()))


def in_words(message: LatencyConfig | DisturbanceConfig) -> str:
    """Return what a message asks for."""
    if isinstance(message, LatencyConfig):
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


def _one_model(own: LatencySettings, configs: Sequence[LatencyConfig]) -> str | None:
    """Return the one model of a schedule that covers all; None if there is none.

    Without spread every model of ours is the constant.
    """
    if own.schedule or own.has_trace:
        return None
    models = {Distribution[config.model.name].value for config in configs if config.spread_s > 0.0}
    if own.spread_s > 0.0 or not isinstance(own.model, Distribution):
        models.add(str(own.model))
    if len(models) > 1:
        return None
    return models.pop() if models else Distribution.CONSTANT.value


def _schedule(own: LatencySettings, changes: Sequence[tuple[int, LatencyConfig]]) -> str:
    points = [{"time_s": 0.0, "mean_s": own.mean_s, "spread_s": own.spread_s, "loss": own.loss}]
    for motion_ns, config in changes:
        is_spread = config.model.name != Distribution.CONSTANT.name
        points.append(
            {
                "time_s": motion_ns / NS_PER_S,
                "mean_s": config.mean_s,
                "spread_s": config.spread_s if is_spread else 0.0,
                "loss": config.loss,
            }
        )
    return _toml(points)


def _toml(rows: Sequence[Mapping[str, Any]]) -> str:
    tables = (
        ", ".join(f"{key} = {json.dumps(value)}" for key, value in row.items()) for row in rows
    )
    return f"[{', '.join(f'{{{table}}}' for table in tables)}]"
