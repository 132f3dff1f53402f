"""Random traffic at random times to the nodes.

A node does not raise, and moves its deadline beyond now within a few ticks.
What leaves is a message of the contract, finite and within its limits; the counters of what
passes no latency line have no gap.
Every frame under an identifier that is received is counted once, as accepted or by cause.
Frames under other identifiers change nothing at all.
The report can be written as JSON, and no figure in it is infinite.
"""

import json
import math
from collections.abc import Callable, Collection, Sequence
from functools import lru_cache
from random import Random

from steer_by_wire.controller.node.node import RECEIVED as CONTROLLER_RECEIVES
from steer_by_wire.controller.node.node import SENT as CONTROLLER_SENDS
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.codec.protection import COUNTERS
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    ControllerSafety,
    ControllerStatus,
    Decoded,
    DelayStatus,
    HandWheelFeedback,
    HandWheelState,
    LateralError,
    Message,
    ModelStatus,
    PlantStatus,
    Rejection,
    SteeringCommand,
    SteeringForce,
    SteeringStatus,
    VehicleState,
    decode,
    resolutions,
)
from steer_by_wire.hand_wheel.node import RECEIVED as HAND_WHEEL_RECEIVES
from steer_by_wire.hand_wheel.node import SENT as HAND_WHEEL_SENDS
from steer_by_wire.hand_wheel.node import HandWheelNode
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.plant_emulator.node.node import OF_HAND_WHEEL, PlantNode
from steer_by_wire.plant_emulator.node.node import RECEIVED as PLANT_RECEIVES
from steer_by_wire.plant_emulator.node.node import SENT as PLANT_SENDS
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.motion_parameters import MotionParams, motion_params
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_S, Node, ReportingNode
from steer_by_wire.runtime.settings import load_settings
from tests.fuzz.traffic import wake_ups

TICKS_MAX = 10
"""Ticks at one time after which a node must have moved its deadline."""
CONTROLLERS = (
    ("practical_pd_ddob", ()),
    ("practical_pd", ("rate_hz=1000",)),
    ("practical_pd_cdob", ("rate_hz=40", "supervision.hold_ms=0")),
    ("practical_pd_dob", ("supervision.recovery_frames=1", "limits.steer_rad_max=1.31071")),
    ("paper_pd_ddob", ("supervision.measurement_timeout_ms=10",)),
    ("paper_pd_cdob", ("limits.steer_rate_rad_s_max=1000", "limits.steer_rad_max=1.3")),
    ("practical_predictor", ()),
    ("practical_smith", ("rate_hz=50",)),
    ("practical_pd_ddob", ("hand_wheel={hand_back_s=0}",)),
)
"""Preset and what is set on top."""
PLANTS = (
    (),
    ("path.kind=straight", "sensor_period_ms=1", "start_on_first_command=false"),
    ("vehicle.speed_m_s=70", "vehicle.rear_cornering_stiffness_n_rad=1000", "duration_s=1e6"),
    ("latency.downlink.order=in_order", "actuator.lag_s=0.1"),
    (
        "latency.downlink.model=gamma", "latency.downlink.mean_s=10",
        "latency.downlink.spread_s=10", "latency.downlink.correlation_time_s=1",
        "latency.uplink.order=as_arrives", "latency.uplink.model=lognormal",
        "latency.uplink.mean_s=1e-9", "latency.uplink.spread_s=10",
    ),
    (
        "path.kind=circle", "path.radius_m=3", "sensor_noise.lateral_error_m=10",
        "sensor_noise.yaw_rate_rad_s=1", "actuator.rate_limit_rad_s=0.001",
        "actuator.angle_limit_rad=0.1", "actuator.dead_band_rad=0.5",
    ),
    ("hand_wheel={}", "steering_force={period_ms=1}", "latency.downlink.mean_s=0.02"),
)  # fmt: skip
"""What is set on top of the defaults."""
HAND_WHEELS = (
    (),
    ("cycle_ms=1", "feedback.law=cdob", "feedback.torque_gradient_n_m=1000"),
    ("driver.two_point={near_gain=1000}", "driver.grip=firm", "feedback.law=model"),
    ("feedback.law=spring", "feedback.passive_n_m_s_max=100", "wheel.inertia_kg_m2=1e-4"),
)


def fuzz_controller(rng: Random) -> None:
    """Let any traffic come to a controller."""
    settings = controller_settings(rng.randint(0, len(CONTROLLERS) - 1))
    known = (*CONTROLLER_RECEIVES, *CONTROLLER_SENDS)
    if settings.hand_wheel is not None:
        known = (*known, HandWheelState)
    drive(rng, lambda: ControllerNode(settings, 0), known, outgoing_of_controller(settings))


def fuzz_plant(rng: Random) -> None:
    """Let any traffic come to a plant."""
    settings, params = plant_settings(rng.randint(0, len(PLANTS) - 1))
    known = (*PLANT_RECEIVES, *PLANT_SENDS)
    if settings.hand_wheel is not None:
        known = (*known, *OF_HAND_WHEEL)
    drive(rng, lambda: PlantNode(settings, 0, params), known, outgoing_of_plant())


def fuzz_hand_wheel(rng: Random) -> None:
    """Let any traffic come to a hand wheel."""
    overrides = HAND_WHEELS[rng.randint(0, len(HAND_WHEELS) - 1)]
    settings = load_settings(HandWheelSettings, overrides=overrides)
    known = (*HAND_WHEEL_RECEIVES, *HAND_WHEEL_SENDS)
    outgoing = Outgoing(HAND_WHEEL_SENDS)
    drive(rng, lambda: HandWheelNode(settings, 0), known, outgoing)


@lru_cache
def controller_settings(number: int) -> ControllerSettings:
    """Return the settings of one of CONTROLLERS."""
    preset, overrides = CONTROLLERS[number]
    return controller_preset(preset, overrides)


@lru_cache
def plant_settings(number: int) -> tuple[PlantSettings, MotionParams]:
    """Return the settings of one of PLANTS, and the motion, whose design takes long."""
    settings = load_settings(PlantSettings, overrides=("interventions=allow", *PLANTS[number]))
    return settings, motion_params(
        settings.vehicle, settings.actuator, settings.path, settings.disturbance
    )


class CommandLimits:
    """Holds the commands that leave against the limits in the settings."""

    def __init__(self, settings: ControllerSettings) -> None:
        rounding_rad = 0.51 * resolutions(SteeringCommand)["steer_rad"]
        rate_rad_s = settings.limits.steer_rate_rad_s_max
        self._steer_rad_max = settings.limits.steer_rad_max + rounding_rad
        self._step_rad_max = rate_rad_s * settings.period_ns / NS_PER_S + 2.0 * rounding_rad
        # Beside a driver the first command is where the wheel stands.
        self._last_rad = None if settings.hand_wheel else 0.0

    def __call__(self, message: Message) -> None:
        """Check the next message that leaves."""
        if not isinstance(message, SteeringCommand):
            return
        last_rad = message.steer_rad if self._last_rad is None else self._last_rad
        step_rad = abs(message.steer_rad - last_rad)
        assert abs(message.steer_rad) <= self._steer_rad_max, f"beyond the limit: {message}"
        assert step_rad <= self._step_rad_max, f"a step of {step_rad} rad: {message}"
        self._last_rad = message.steer_rad


class Outgoing:
    """Checks every frame that leaves a node.

    ``directly``  what it sends at once, so that no counter may be missing
    ``delayed``   what leaves through a latency line
    ``judge``     checks each message too
    """

    def __init__(
        self,
        directly: Collection[type[Message]],
        delayed: Collection[type[Message]] = (),
        judge: Callable[[Message], None] = lambda _message: None,
    ) -> None:
        self._next = {CAN_IDS[message_type]: 0 for message_type in directly}
        self._sends = {CAN_IDS[message_type] for message_type in (*directly, *delayed)}
        self._judge = judge

    def look(self, frames: Sequence[Frame]) -> None:
        """Raise AssertionError for a frame that must not leave."""
        for frame in frames:
            assert frame.can_id in self._sends, f"not for this node to send: {frame}"
            # Only the values may be missing, in a frame that is right otherwise.
            decoded = decode(frame)
            if decoded is not Rejection.NOT_AVAILABLE:
                assert isinstance(decoded, Decoded), f"{frame} is {decoded}"
            if isinstance(decoded, Decoded):
                for value in decoded.message:
                    assert math.isfinite(value), f"not finite: {decoded}"
                self._judge(decoded.message)
            if frame.can_id in self._next:
                wanted, counter = self._next[frame.can_id], frame.data[2]
                assert counter == wanted, f"counter {counter} where {wanted} is due: {frame}"
                self._next[frame.can_id] = (counter + 1) % COUNTERS


def outgoing_of_controller(settings: ControllerSettings) -> Outgoing:
    """Return what checks the frames of a controller."""
    directly = (SteeringCommand, ControllerStatus, ControllerSafety, DelayStatus, ModelStatus)
    directly = (*directly, HandWheelFeedback)
    return Outgoing(directly, judge=CommandLimits(settings))


def outgoing_of_plant() -> Outgoing:
    """Return what checks the frames of a plant."""
    return Outgoing(
        (PlantStatus,), delayed=(LateralError, SteeringStatus, SteeringForce, VehicleState)
    )


def drive(
    rng: Random,
    make_node: Callable[[], ReportingNode],
    known: Collection[type[Message]],
    outgoing: Outgoing,
) -> None:
    """Run a node through what is drawn.

    ``known``  what it receives, and what nobody else may send

    A second node, which does not receive the frames meant for others, has to do the same.
    """
    node, twin = make_node(), make_node()
    ids = {CAN_IDS[message_type] for message_type in known}
    taken = 0
    for now_ns, frames in wake_ups(rng):
        for frame in frames:
            sent = list(node.on_frame(frame, now_ns))
            outgoing.look(sent)
            if frame.can_id in ids:
                taken += 1
                assert list(twin.on_frame(frame, now_ns)) == sent, "it depends on other traffic"
        sent = _tick(node, now_ns)
        outgoing.look(sent)
        assert _tick(twin, now_ns) == sent, "it depends on traffic that is not for it"
    report = node.report()
    counted = report["accepted"] + sum(report["rejected"].values())
    assert counted == taken, f"{taken} frames came, {counted} were counted: {report}"
    json.dumps(report)


def _tick(node: Node, now_ns: int) -> list[Frame]:
    sent: list[Frame] = []
    for _ in range(TICKS_MAX):
        if node.deadline_ns > now_ns:
            return sent
        sent += node.on_tick(now_ns)
    raise AssertionError(f"the deadline stays at {node.deadline_ns}, now is {now_ns}")
