"""What a node remembers of the bus for a law that looks back (``controller.history.history``)."""

from collections.abc import Mapping
from typing import Any

from ...dbc.messages import LateralError, PathAhead, SteeringStatus
from ...runtime.node import NS_PER_S
from ..interface.law import LoopDelay
from ..supervision import AgeLimits
from .history import (
    NO_COMMANDS,
    NO_ECHOES,
    NO_ERRORS,
    RING_SIZE,
    HistoryParams,
    Rings,
    command_step,
    echo_step,
    error_step,
    history_of,
    loop_delay_at,
    path_step,
)
from .loop_delay import LoopDelayParams
from .plan import ROW_LENGTH


class BusHistory:
    """Stores commands, measurements and echoes for a node.

    ``params``  periods and averaging
    ``limits``  age limits of the delay and of the vehicle's speed
    ``keeps_plans``  whether the law plans
    """

    def __init__(
        self, params: LoopDelayParams, limits: AgeLimits, *, keeps_plans: bool = False
    ) -> None:
        self._params = HistoryParams(params, limits)
        size = RING_SIZE
        self._rings = Rings(
            sent_rad=[0.0] * size,
            lateral_error_m=[0.0] * size,
            heading_error_rad=[0.0] * size,
            has_error=[False] * size,
            applied_tick=[-1] * size,
            is_overruled=[False] * size,
            wheel_rad=[0.0] * size,
            command_tick=[-1] * size,
            curvature_1_m=[0.0] * size,
            plans=[[0.0] * ROW_LENGTH for _ in range(size if keeps_plans else 1)],
        )
        self._errors = NO_ERRORS
        self._echoes = NO_ECHOES
        self._commands = NO_COMMANDS
        self._vehicle_ns = -1
        self._path_end = -1
        self._first_period: int | None = None
        self.history = history_of(self._rings)

    def on_vehicle(self, now_ns: int) -> None:
        """Record that the vehicle's speed is known."""
        self._vehicle_ns = now_ns

    def on_path(self, path: PathAhead, speed_m_s: float) -> None:
        """Store the path ahead, at the vehicle's speed."""
        counter, spacing_m, *ahead_1_m = path
        params, rings, path_end, errors = self._params, self._rings, self._path_end, self._errors
        self._path_end = path_step(
            params, rings, path_end, errors, counter, spacing_m, ahead_1_m, speed_m_s
        )

    def on_error(self, error: LateralError, counter: int, now_ns: int) -> None:
        """Store a measurement."""
        self._errors = error_step(
            self._params, self._rings, self._errors, self._echoes, counter, *error, now_ns
        )

    def on_echo(self, status: SteeringStatus, counter: int, now_ns: int) -> None:
        """Store an echo."""
        wheel_rad, applied, code = status
        params, rings = self._params, self._rings
        errors, commands = self._errors, self._commands
        self._echoes = echo_step(
            params, rings, self._echoes, errors, commands, counter, applied, code, wheel_rad, now_ns
        )

    def on_command(self, period: int, sent_rad: float, *, is_planned: bool = False) -> None:
        """Store the command of a control period, ``is_planned`` if its plan is stored already."""
        if self._first_period is None:
            self._first_period = period
        self._commands = command_step(
            self._rings, self._commands, self._tick(period), sent_rad, is_planned
        )

    def plan_of(self, period: int) -> list[float]:
        """Return the row of a control period, where its plan is."""
        return self._rings.plans[self._tick(period) & (len(self._rings.plans) - 1)]

    def loop_delay(self, period: int, now_ns: int) -> LoopDelay:
        """Return the delay in a control period."""
        tick, errors, echoes = self._tick(period), self._errors, self._echoes
        path_end, vehicle_ns = self._path_end, self._vehicle_ns
        return loop_delay_at(self._params, errors, echoes, path_end, vehicle_ns, tick, now_ns)

    def sensor_period(self) -> Mapping[str, Any]:
        """Return whether the sensors' period agrees with its setting, ready for JSON.

        ``times_wrong``  how often a different period was detected
        ``measured_s``   that period [s], None if there was none
        """
        rate = self._errors.rate
        return {
            "setting_s": self._params.loop_delay.sensor_period_ns / NS_PER_S,
            "times_wrong": rate.times_wrong,
            "measured_s": rate.measured_ns / NS_PER_S if rate.times_wrong else None,
        }

    def _tick(self, period: int) -> int:
        """Return the number of a control period, the first with a command being 0."""
        return 0 if self._first_period is None else period - self._first_period
