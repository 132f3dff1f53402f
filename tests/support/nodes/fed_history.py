"""The history of the controller, fed with echoes and measurements as its node does."""

from steer_by_wire.controller.age_limits import AgeLimits
from steer_by_wire.controller.history.echo_delay import LoopDelayParams
from steer_by_wire.controller.history.history import BusHistory
from steer_by_wire.controller.law_interface import LoopDelay
from steer_by_wire.dbc.messages import LateralError, SteeringStatus, SteeringStatusCode
from tests.support.frames.made_messages import message_with

MS = 1_000_000
PERIOD_NS = 10 * MS
PARAMS = LoopDelayParams(PERIOD_NS, PERIOD_NS, 50.0)
LIMITS = AgeLimits(300 * MS, 300 * MS, 150 * MS)
APPLYING, NO_COMMAND = SteeringStatusCode.APPLYING, SteeringStatusCode.NO_COMMAND


def echo(counter: int, status: SteeringStatusCode = APPLYING) -> SteeringStatus:
    return message_with(SteeringStatus, applied_counter=counter, status=status)


def error(value_m: float) -> LateralError:
    return message_with(LateralError, lateral_error_m=value_m, heading_error_rad=0.1 * value_m)


class FedHistory:
    """Feeds a history as the node does: echo and measurement of a sample, then the tick."""

    def __init__(self) -> None:
        self.history = BusHistory(PARAMS, LIMITS)

    def command(self, period: int, steer_rad: float) -> None:
        self.history.on_command(period, steer_rad)

    def sample(self, number: int, counter: int | None) -> None:
        now_ns = number * PERIOD_NS
        status = echo(0, NO_COMMAND) if counter is None else echo(counter % (1 << 16))
        self.history.on_echo(status, number % 256, now_ns)
        self.history.on_vehicle(0.0, number % 256, now_ns)
        self.history.on_error(error(0.001 * number), number % 256, now_ns)

    def loop_delay(self, period: int) -> LoopDelay:
        return self.history.loop_delay(period, period * PERIOD_NS)


def driven(samples: int, latency: int, start: int = 0) -> FedHistory:
    """Return a wire after so many samples, every command in effect ``latency`` samples later."""
    fed = FedHistory()
    for number in range(start, start + samples):
        tick = number - start - latency
        fed.sample(number, tick if tick >= 0 else None)
        fed.command(number, 0.01 * (number - start))
    return fed
