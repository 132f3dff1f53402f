"""Live disturbances: a tool sets them over the bus, in place of those of the settings.

A friction that no step of the settings has needs new transition tables. Computing them takes some
tens of milliseconds, during which the plant takes no sample.
"""

from ...dbc.messages import DisturbanceChange
from ..settings import PlantSettings
from ..vehicle.car.car_design import under_load
from ..vehicle.car.car_motion import CarMotionParams
from ..vehicle.disturbance import Load, disturbance_interval
from ..vehicle.motion_parameters import transitions, vehicle_params
from ..vehicle.moving_vehicle import AnyMotionParams


class LiveDisturbances:
    """Holds the newest request until the motion has reached its time.

    ``is_asked``  whether there is a request that has not been taken
    """

    def __init__(self, settings: PlantSettings, params: AnyMotionParams) -> None:
        self._vehicle = vehicle_params(settings.vehicle)
        self._arm_m = settings.disturbance.side_force_arm_m
        self._params = params
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
                loaded = [under_load(x, load, self._arm_m) for x in self._params.intervals]
                self._params = self._params._replace(intervals=loaded)
            else:
                intervals = [disturbance_interval(0, load, self._arm_m, self._vehicle)]
                table, rows = transitions(self._vehicle, self._params.actuator, intervals)
                self._params = self._params._replace(
                    intervals=intervals, table=table, first_rows=rows
                )
        return self._params
