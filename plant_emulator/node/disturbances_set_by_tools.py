"""Disturbances that a tool sets while the vehicle drives, in place of those of the settings.

A friction that the run has not met yet costs the plant its transition tables, some tens of
milliseconds in which it senses nothing. One that a step of the settings names costs nothing.
"""

from ...dbc.messages import DisturbanceConfig
from ..settings import PlantSettings
from ..vehicle.disturbance import DisturbanceInterval, Load, disturbance_interval
from ..vehicle.motion_parameters import MotionParams, transitions, vehicle_params


class LiveDisturbances:
    """Holds what a tool has asked for until the motion has come to that time.

    Beside the tables of the settings it keeps those of one friction more, the newest: what a bus
    brings must not fill the memory.

    ``is_asked``  whether there is something that has not been taken
    """

    def __init__(self, settings: PlantSettings, params: MotionParams) -> None:
        self._vehicle = vehicle_params(settings.vehicle)
        self._arm_m = settings.disturbance.side_force_arm_m
        self._designed = self._params = params
        self._friction, self._first_rows = params.intervals[0].friction, params.first_rows[0]
        self._asked: DisturbanceConfig | None = None
        self.is_asked = False

    def ask(self, config: DisturbanceConfig) -> None:
        """Take what a tool asks for; the newest counts."""
        self._asked, self.is_asked = config, True

    def params(self) -> MotionParams:
        """Return the motion's parameters with what was asked for, from now on."""
        asked, self._asked, self.is_asked = self._asked, None, False
        if asked is not None:
            # Rounded, so that 1 - 0.7 is the 0.3 of somebody's settings.
            load = Load(*asked[:3], round(1.0 - asked.friction_loss, 6))
            interval = disturbance_interval(0, load, self._arm_m, self._vehicle)
            if interval.friction != self._friction:
                self._find_tables(interval)
            self._params = self._params._replace(
                intervals=[interval], first_rows=[self._first_rows]
            )
        return self._params

    def _find_tables(self, interval: DisturbanceInterval) -> None:
        """Take the tables of a friction from the settings, or compute them in place of others."""
        designed = self._designed
        self._friction = interval.friction
        for known, rows in zip(designed.intervals, designed.first_rows, strict=True):
            if known.friction == interval.friction:
                self._first_rows = rows
                return
        table, (first_rows,) = transitions(self._vehicle, designed.actuator, [interval])
        start = len(designed.table)
        self._params = self._params._replace(table=[*designed.table, *table])
        self._first_rows = [start + row for row in first_rows]
