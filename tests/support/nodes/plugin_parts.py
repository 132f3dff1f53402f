"""Plug-in parts of the plant as a stranger may write them: right and wrong."""

from typing import Any

from pydantic import Field

from steer_by_wire import (
    DisturbanceModel,
    DisturbanceStep,
    LatencyModel,
    PathModel,
    Settings,
    VehicleModel,
    VehicleState,
    path_of_curvature,
    path_through,
)
from steer_by_wire.plant_emulator.vehicle.settings import VehicleInput
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices


class Share(Settings):
    share: float = Field(0.1, ge=0.0, le=1.0)
    slow_s: float = Field(ge=0.0, le=10.0)


def two_routes(u: float, mean_s: float, spread_s: float, own: Share) -> float:
    fast_s = mean_s + spread_s * u
    return fast_s if u < 1.0 - own.share else fast_s + own.slow_s


TWO_ROUTES = LatencyModel(two_routes, settings=Share)
LIKE_UNIFORM = LatencyModel(
    lambda u, mean_s, spread_s, _own: max(0.0, mean_s + 3.0**0.5 * spread_s * (2.0 * u - 1.0))
)
NEGATIVE = LatencyModel(lambda _u, _mean_s, _spread_s, _own: -1.0)
DIVIDES = LatencyModel(lambda u, mean_s, _spread_s, _own: u / mean_s)
RARELY_NAN = LatencyModel(
    lambda u, mean_s, _spread_s, _own: float("nan") if 0.6 < u < 0.7 else mean_s
)


class Bend(Settings):
    curvature_1_m: float = Field(0.02, ge=-0.1, le=0.1)


BEND = PathModel(
    lambda own: path_of_curvature([(5.0, 0.0), (8.0, own.curvature_1_m), (11.0, 0.0)]),
    settings=Bend,
)
SQUARE = PathModel(
    lambda _own: path_through([(0, 0), (30, 0), (30, 30), (0, 30)], closed=True), settings=None
)
ONE_POINT = PathModel(lambda _own: path_through([(0, 0)]))
POINTS = PathModel(lambda _own: [(0, 0), (1, 0)])


def single_track(
    p: VehicleParams, x: VehicleState, u: VehicleInput, _own: Any
) -> tuple[float, ...]:
    a, b = state_matrices(p)
    rates = a @ list(x) + b @ list(u)
    return tuple(rates.tolist())


SAME = VehicleModel(single_track)
SHORT = VehicleModel(lambda _p, x, _u, _own: x[:3])
FALLS = VehicleModel(lambda _p, _x, _u, _own: [0.0, 0.0, 0.0, 1.0 / 0.0])
EXPLODES = VehicleModel(lambda _p, x, _u, _own: [0.0, 0.0, 0.0, 1e300 * (1.0 + abs(x[3]))])

PUSH = [
    DisturbanceStep(at_s=0.5, steering_offset_rad=0.02),
    DisturbanceStep(at_s=1.0, side_force_n=300.0, friction=0.8),
]
PUSHES = DisturbanceModel(lambda _own: PUSH)
BACKWARDS = DisturbanceModel(lambda _own: reversed(PUSH))
NUMBERS = DisturbanceModel(lambda _own: [1.0])
