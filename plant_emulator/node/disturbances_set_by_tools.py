"""Live disturbances: a tool sets them over the bus, in place of those of the settings.

A friction that no step of the settings has needs new transition tables. Computing them takes some
tens of milliseconds, during which the plant takes no sample.
"""

from typing import Any

from ...dbc.messages import DisturbanceChange
from ..settings import PlantSettings
from ..vehicle.car.car_design import under_load
from ..vehicle.car.car_motion import CarMotionParams
from ..vehicle.disturbance import DisturbanceInterval, Load, disturbance_interval
from ..vehicle.motion_parameters import MotionParams, transitions, vehicle_params
from ..vehicle.moving_vehicle import AnyMotionParams


class LiveDisturbances:
    """Holds the newest request until the motion has reached its time.

    Besides the tables of the settings it keeps those of the newest friction only, so that requests
    cannot fill the memory.

    ``is_asked``  whether there is a request that has not been taken
    """

    def __init__(self, settings: PlantSettings, params: AnyMotionParams) -> None:
        self._vehicle = vehicle_params(settings.vehicle)
        self._arm_m = settings.disturbance.side_force_arm_m
        self._designed = self._params = params
        self._asked: DisturbanceChange | None = None
        self.is_asked = False

    def ask(self, config: DisturbanceChange) -> None:
        """Take the request of a tool; only the newest counts."""
        self._asked, self.is_asked = config, True

    def params(self) -> AnyMotionParams:
        """Return the parameters of the motion from now on, with the requested disturbance."""
        asked, self._asked, self.is_asked = self._asked, None, False
        if asked is not None:
            # Rounded, so that 1 - 0.7 equals a 0.3 in the settings.
            load = Load(*asked[:3], round(1.0 - asked.friction_loss, 6))
            if isinstance(self._params, CarMotionParams):
                intervals = [under_load(x, load, self._arm_m) for x in self._params.intervals]
                self._params = self._params._replace(intervals=intervals)
            else:
                interval = disturbance_interval(0, load, self._arm_m, self._vehicle)
                self._params = self._with_tables(self._params, interval)
        return self._params

    def _with_tables(self, present: MotionParams, interval: DisturbanceInterval) -> MotionParams:
        """Return the parameters in an interval, with the tables of its friction.

        They are the present ones, those of the settings, or computed.
        """
        designed: Any = self._designed
        for known in (present, designed):
            for other, rows in zip(known.intervals, known.first_rows, strict=True):
                if other.friction == interval.friction:
                    return present._replace(intervals=[interval], first_rows=[rows])
        further, (first_rows,) = transitions(self._vehicle, designed.actuator, [interval])
        start = len(designed.table)
        table = [*designed.table, *further]
        rows = [start + row for row in first_rows]
        return present._replace(intervals=[interval], first_rows=[rows], table=table)
