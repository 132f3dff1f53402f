"""Disturbances that a tool sets while the vehicle drives, in place of those of the settings.

A friction that the run has not met yet costs the plant its transition tables, some tens of
milliseconds in which it senses nothing. One that a step of the settings names costs nothing.
"""

import numpy as np

from ..dbc.messages import DisturbanceConfig
from .disturbance import Load, disturbance_interval
from .motion_design import MotionParams, transitions, vehicle_params
from .propagation import table_rows
from .settings import PlantSettings


class Disturbing:
    """Holds what a tool has asked for until the motion has come to that time."""

    def __init__(self, settings: PlantSettings, params: MotionParams) -> None:
        self._vehicle = vehicle_params(settings.vehicle)
        self._arm_m = settings.disturbance.side_force_arm_m
        self._params = params
        self._first_rows = {
            interval.friction: rows
            for interval, rows in zip(params.intervals, params.first_rows, strict=True)
        }
        self._asked: DisturbanceConfig | None = None

    def ask(self, config: DisturbanceConfig) -> None:
        """Take what a tool asks for; the newest counts."""
        self._asked = config

    @property
    def is_asked(self) -> bool:
        """Whether there is something that has not been taken."""
        return self._asked is not None

    def params(self) -> MotionParams:
        """Return the motion's parameters with what was asked for, from now on."""
        asked, self._asked = self._asked, None
        if asked is not None:
            # Rounded, so that 1 - 0.7 is the 0.3 of somebody's settings.
            load = Load(*asked[:3], round(1.0 - asked.friction_loss, 6))
            interval = disturbance_interval(0, load, self._arm_m, self._vehicle)
            self._params = self._params._replace(intervals=[interval])
            self._compute_tables(interval.friction)
            self._params = self._params._replace(first_rows=[self._first_rows[interval.friction]])
        return self._params

    def _compute_tables(self, friction: float) -> None:
        """Append the tables of a friction, unless they are there."""
        if friction in self._first_rows:
            return
        params = self._params
        tables, first_rows = transitions(self._vehicle, params.actuator, params.intervals)
        start = len(params.table)
        self._params = params._replace(table=[*params.table, *table_rows(np.asarray(tables))])
        self._first_rows[friction] = [start + row for row in first_rows[0].tolist()]
