"""A car on a road, written apart: it shares no line with the plant but the messages on the bus.

Single track with the Magic Formula and relaxation in global coordinates, RK4 at 1 ms, the speed
constant; a road drawn from its curvature by small steps; deviations are distances to the nearest of
its points. Between controller and car only frames travel, the commands with a constant latency.
"""

from collections import deque
from math import atan, cos, sin
from typing import NamedTuple

import numpy as np

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import (
    Decoded,
    LateralError,
    Sender,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    decode,
)
from steer_by_wire.runtime.array_types import FloatArray
from tests.support.frames.made_messages import message_with, motion_of

MASS_KG, INERTIA_KG_M2, FRONT_M, REAR_M, PREVIEW_M = 1750.0, 2900.0, 1.25, 1.5, 2.0
STIFFNESS_N_RAD = 120e3, 150e3
RELAXATION_M, SHAPE = 0.3, 1.3
LAG_S, RATE_RAD_S, PLAY_RAD = 0.05, 0.6, 0.0061
STEP_S = 1e-3
ROAD_STEP_M = 0.01


class Road(NamedTuple):
    """Points of a road, ``ROAD_STEP_M`` apart."""

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    curvature_1_m: FloatArray


def lane_change(start_m: float, offset_m: float, peak_1_m: float) -> Road:
    """Return a road straight, left, right, straight: its curvature is linear between the peaks."""
    low, high = 5.0, 400.0
    for _ in range(30):
        arc_m = 0.5 * (low + high)
        road = _lane_change(0.0, arc_m, peak_1_m, 0.0)
        low, high = (arc_m, high) if road.y_m[-1] < offset_m else (low, arc_m)
    return _lane_change(start_m, low, peak_1_m, 400.0)


def _lane_change(start_m: float, arc_m: float, peak_1_m: float, end_m: float) -> Road:
    s = np.arange(0.0, start_m + arc_m + end_m, ROAD_STEP_M)
    at = [0.0, start_m, start_m + 0.25 * arc_m, start_m + 0.75 * arc_m, start_m + arc_m]
    curvature = np.interp(s, at, [0.0, 0.0, peak_1_m, -peak_1_m, 0.0])
    heading = np.cumsum(curvature) * ROAD_STEP_M
    x, y = np.cumsum(np.cos(heading)) * ROAD_STEP_M, np.cumsum(np.sin(heading)) * ROAD_STEP_M
    return Road(x, y, heading, curvature)


class Place(NamedTuple):
    """Nearest point of the road, as an index, and the distance to the left of it."""

    index: int
    left_m: float


def nearest(road: Road, x_m: float, y_m: float, near: int) -> Place:
    """Return the nearest point of the road, not far from the point ``near``."""
    low = max(near - 300, 0)
    window = slice(low, near + 300)
    index = low + int(np.argmin(np.hypot(road.x_m[window] - x_m, road.y_m[window] - y_m)))
    heading = road.heading_rad[index]
    across = -(x_m - road.x_m[index]) * sin(heading) + (y_m - road.y_m[index]) * cos(heading)
    return Place(index, across)


def rates(state: FloatArray, command_rad: float, speed_m_s: float, friction: float) -> FloatArray:
    """Return d/dt of (x, y, heading, v, r, front and rear slip, wheel)."""
    _, _, heading, v, r, front_slip, rear_slip, wheel = state
    play = min(max(command_rad - wheel, -PLAY_RAD), PLAY_RAD)
    wheel_rate = (command_rad - play - wheel) / LAG_S
    wheel_rate = min(max(wheel_rate, -RATE_RAD_S), RATE_RAD_S)
    forces = []
    for slip, stiffness, arm_m in zip(
        (front_slip, rear_slip), STIFFNESS_N_RAD, (REAR_M, FRONT_M), strict=True
    ):
        grip_n = friction * MASS_KG * 9.81 * arm_m / (FRONT_M + REAR_M)
        forces.append(grip_n * sin(SHAPE * atan(stiffness * slip / (SHAPE * grip_n))))
    front_n = forces[0] * cos(wheel)
    front_steady = wheel - atan((v + FRONT_M * r) / speed_m_s)
    rear_steady = -atan((v - REAR_M * r) / speed_m_s)
    found: FloatArray = np.array(
        [
            speed_m_s * cos(heading) - v * sin(heading),
            speed_m_s * sin(heading) + v * cos(heading),
            r,
            (front_n + forces[1]) / MASS_KG - speed_m_s * r,
            (FRONT_M * front_n - REAR_M * forces[1]) / INERTIA_KG_M2,
            speed_m_s / RELAXATION_M * (front_steady - front_slip),
            speed_m_s / RELAXATION_M * (rear_steady - rear_slip),
            wheel_rate,
        ]
    )
    return found


def largest_deviation_m(
    controller: ControllerSettings,
    road: Road,
    speed_m_s: float,
    friction: float,
    latency_s: float,
    duration_s: float,
) -> float:
    """Return the largest distance of the centre of gravity from the road."""
    node = ControllerNode(controller, 0)
    senders = {kind: Sender(kind) for kind in (LateralError, SteeringStatus, VehicleState)}
    state: FloatArray = np.zeros(8)
    under_way: deque[tuple[int, float, int]] = deque()
    command_rad, applied, worst_m = 0.0, -1, 0.0
    cg, preview = 0, round(PREVIEW_M / ROAD_STEP_M)
    latency_ms = round(1e3 * latency_s)
    for ms in range(round(1e3 * duration_s)):
        now_ns = ms * 1_000_000
        while under_way and under_way[0][0] <= ms:
            _, command_rad, applied = under_way.popleft()
        if ms % 10 == 0:
            x, y, heading, _, r, _, _, wheel = state.tolist()
            cg, off_m = nearest(road, x, y, cg)
            worst_m = max(worst_m, abs(off_m))
            ahead_x, ahead_y = x + PREVIEW_M * cos(heading), y + PREVIEW_M * sin(heading)
            preview, error_m = nearest(road, ahead_x, ahead_y, preview)
            if worst_m > 20.0:
                return worst_m
            code = SteeringStatusCode.NO_COMMAND if applied < 0 else SteeringStatusCode.APPLYING
            for message in (
                message_with(
                    LateralError,
                    lateral_error_m=error_m,
                    heading_error_rad=heading - float(road.heading_rad[preview]),
                ),
                message_with(
                    SteeringStatus,
                    wheel_angle_rad=wheel,
                    applied_counter=max(applied, 0),
                    status=code,
                ),
                motion_of(speed_m_s, r, float(road.curvature_1_m[preview])),
            ):
                node.on_frame(senders[type(message)].frame(message), now_ns)
            while node.deadline_ns <= now_ns:
                for frame in node.on_tick(now_ns):
                    sent = decode(frame)
                    if isinstance(sent, Decoded) and isinstance(sent.message, SteeringCommand):
                        one = sent.message
                        under_way.append((ms + latency_ms, one.steer_rad, one.command_counter))
            while under_way and under_way[0][0] <= ms:
                _, command_rad, applied = under_way.popleft()
        k_1 = rates(state, command_rad, speed_m_s, friction)
        k_2 = rates(state + 0.5 * STEP_S * k_1, command_rad, speed_m_s, friction)
        k_3 = rates(state + 0.5 * STEP_S * k_2, command_rad, speed_m_s, friction)
        k_4 = rates(state + STEP_S * k_3, command_rad, speed_m_s, friction)
        state = state + STEP_S / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)
    return worst_m
