"""Live disturbances: a tool sets them by DISTURBANCE_CONFIG, in place of those of the settings.

A friction that no step of the settings has needs new transition tables. Computing them takes some
tens of milliseconds, during which the plant takes no sample.
"""

from ...dbc.messages import DisturbanceConfig
from ..settings import PlantSettings
from ..vehicle.disturbance import DisturbanceInterval, Load, disturbance_interval
from ..vehicle.motion_parameters import MotionParams, transitions, vehicle_params


class LiveDisturbances:
    """Holds the newest request until the motion has reached its time.

    Besides the tables of the settings it keeps those of the newest friction only, so that requests
    cannot fill the memory.

    ``is_asked``  whether there is a request that has not been taken
    """

    def __init__(self, settings: PlantSettings, params: MotionParams) -> None:
        self._vehicle = vehicle_params(settings.vehicle)
        self._arm_m = settings.disturbance.side_force_arm_m
        self._designed = self._params = params
        self._friction, self._first_rows = params.intervals[0].friction, params.first_rows[0]
        self._asked: DisturbanceConfig | None = None
        self.is_asked = False

    def ask(self, config: DisturbanceConfig) -> None:
        """Take the request of a tool; only the newest counts."""
        self._asked, self.is_asked = config, True

    def params(self) -> MotionParams:
        """Return the parameters of the motion from now on, with the requested disturbance."""
        asked, self._asked, self.is_asked = self._asked, None, False
        if asked is not None:
            # Rounded, so that 1 - 0.7 equals a 0.3 in the settings.
            load = Load(*asked[:3], round(1.0 - asked.friction_loss, 6))
            interval = disturbance_interval(0, load, self._arm_m, self._vehicle)
            if interval.friction != self._friction:
                self._find_tables(interval)
            self._params = self._params._replace(
                intervals=[interval], first_rows=[self._first_rows]
            )
        return self._params

    def _find_tables(self, interval: DisturbanceInterval) -> None:
        """Find the tables of a friction among those of the settings, or compute them."""
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
