"""The vehicle's motion by equations of another package, integrated step by step.

Wheel, path and disturbances are those of ``advance_motion``, exact and event by event. Between
events the vehicle's own state advances by the fourth-order Runge-Kutta method in steps of at most
1 ms. With (1) as the plug-in, a test finds an error below 1e-9 m.
"""

from ...runtime.settings.plugin import call_part
from .exact_propagation import DELTA
from .motion_events import MotionState, advance_motion, event_ns_of, interval_of, with_vehicle
from .motion_parameters import MotionParams, vehicle_params
from .moving_vehicle import AnyMotionParams, Motion
from .settings import VehicleInput, VehicleSettings, VehicleState, find_vehicle_model
from .single_track_model import VehicleParams, on_friction

STEP_NS = 1_000_000


def make_motion(settings: VehicleSettings, params: AnyMotionParams) -> Motion:
    """Return the motion at its start, with the settings' equations."""
    if settings.model is None:
        return Motion(params)
    return Motion(params, PluginEquations(settings, settings.model).advance)


class PluginEquations:
    """Advances a motion by a vehicle model of another package."""

    def __init__(self, settings: VehicleSettings, place: str) -> None:
        self._model = find_vehicle_model(place)
        self._what = f"vehicle model {place}"
        self._own = settings.own
        self._vehicle = vehicle_params(settings)

    def advance(self, p: MotionParams, x: MotionState, to_ns: int) -> MotionState:
        """Return the state at ``to_ns`` >= its time; raises PartError if the model fails."""
        while True:
            time_ns, _, _ = x
            end_ns = min(to_ns, event_ns_of(x), time_ns + STEP_NS)
            x = self._step(p, x, end_ns)
            if end_ns == to_ns:
                return x

    def _step(self, p: MotionParams, x: MotionState, end_ns: int) -> MotionState:
        """Return the state at ``end_ns``, before which there is no event."""
        time_ns, z, _ = x
        half_s = 0.5e-9 * (end_ns - time_ns)
        vehicle = on_friction(self._vehicle, p.intervals[interval_of(x)].friction)
        after = advance_motion(p, x, end_ns)
        _, middle, _ = advance_motion(p, x, (time_ns + end_ns) // 2)
        _, at_end, _ = after
        beta, r, psi, y, wheel_rad, _, curvature_1_m, curvature_rate_1_m_s, *disturbances = z
        begin = VehicleInput(wheel_rad, curvature_1_m, *disturbances)
        curvature_1_m += curvature_rate_1_m_s * half_s
        midway = VehicleInput(middle[DELTA], curvature_1_m, *disturbances)
        # The curvature may jump at the end; this is its value before.
        curvature_1_m += curvature_rate_1_m_s * half_s
        end = VehicleInput(at_end[DELTA], curvature_1_m, *disturbances)
        start = VehicleState(beta, r, psi, y)
        k1 = self._rates(vehicle, start, begin)
        k2 = self._rates(vehicle, _along(start, k1, half_s), midway)
        k3 = self._rates(vehicle, _along(start, k2, half_s), midway)
        k4 = self._rates(vehicle, _along(start, k3, 2.0 * half_s), end)
        mean = VehicleState(
            *((a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        )
        return with_vehicle(after, *_along(start, mean, 2.0 * half_s))

    def _rates(self, vehicle: VehicleParams, x: VehicleState, u: VehicleInput) -> VehicleState:
        return call_part(
            self._what, lambda: VehicleState(*self._model.rates(vehicle, x, u, self._own))
        )


def _along(start: VehicleState, rates: VehicleState, time_s: float) -> VehicleState:
    return VehicleState(*(x + time_s * rate for x, rate in zip(start, rates, strict=True)))
