"""What the controller has received and reports: random lives against rules written apart."""

from random import Random

from steer_by_wire.controller.limits.designed_ranges import ValiditySettings
from steer_by_wire.controller.node.modes import Supervision, Supervisor
from steer_by_wire.controller.node.newest_messages import Received
from steer_by_wire.controller.node.safety_alarms import SafetyReport
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import (
    ControllerFault,
    ControllerSafety,
    Decoded,
    Freshness,
    LateralError,
    Message,
    Mode,
    MotionRequest,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    Validity,
    VehicleState,
    decode,
    encode,
)

MS = 1_000_000
LIMITS_NS: dict[type[Message], int] = {
    LateralError: 135 * MS,
    SteeringStatus: 80 * MS,
    VehicleState: 100 * MS,
}
MESSAGES: dict[type[Message], Message] = {
    LateralError: LateralError(0.25, 0.0),
    SteeringStatus: SteeringStatus(0.1, 7, SteeringStatusCode.APPLYING),
    VehicleState: VehicleState(1.5, 0.0, 0.0),
}
INTERVAL_NS = 20 * MS
STEPS_NS = (0, 1, MS, 5 * MS, 10 * MS, 10 * MS, 20 * MS, 20 * MS - 1, 60 * MS, 80 * MS)
TO_SLOW_DOWN = {Validity.SPEED_HIGH, Validity.DELAY_LONG, Validity.MODEL_MISFIT}
OVERRULING = {
    SteeringStatusCode.LIMITED_BY_SAFETY,
    SteeringStatusCode.FALLBACK,
    SteeringStatusCode.SAFE_STATE,
}
TO_STOP = {SteeringStatusCode.FALLBACK, SteeringStatusCode.SAFE_STATE}
TABLE = ValiditySettings(speed_m_s=(1.0, 2.0), delay_ms_max=250.0)
DRIVES, TICKS = 25, 60


def settings_of_test() -> ControllerSettings:
    preset = controller_preset("practical_pd")
    table = {
        "measurement_timeout_ms": 135.0,
        "steering_status_timeout_ms": 80.0,
        "vehicle_state_timeout_ms": 100.0,
    }
    supervision = preset.supervision.model_copy(update=table)
    return preset.model_copy(update={"supervision": supervision})


SETTINGS = settings_of_test()


class Life:
    """A controller's messages and report, and the rules as they are told."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self.now_ns = random.choice((0, 10**12))
        self.received = Received(SETTINGS)
        self.modes = Supervisor(Supervision(135 * MS, 500 * MS, 5), self.now_ns)
        self.report = SafetyReport(TABLE, self.received, self.modes, self.now_ns)
        self.fault = ControllerFault.NONE
        self.validity = Validity.VALID
        self.counters = dict.fromkeys(LIMITS_NS, random.randrange(256))
        self.before: ControllerSafety | None = None
        self.reported: ControllerSafety | None = None
        self.reported_ns = 0
        self.went_stale = [0, 0, 0]
        self.first_tick_ns = self.now_ns + random.choice((0, 0, 200 * MS))

    def arrival_ns(self, kind: type[Message]) -> int | None:
        return self.received.reception.newest(kind).arrival_ns

    def freshness(self, kind: type[Message]) -> Freshness:
        arrival_ns = self.arrival_ns(kind)
        if arrival_ns is None:
            return Freshness.NEVER_SEEN
        is_fresh = self.now_ns - arrival_ns <= LIMITS_NS[kind]
        return Freshness.FRESH if is_fresh else Freshness.STALE

    def facts(self) -> ControllerSafety:
        """Return what is to be reported now, but for the lost frames."""
        refused = sum(self.received.reception.rejected.values()) + self.received.unauthenticated
        is_stop = self.modes.mode is Mode.SAFE_STOP or not self.modes.goes_forward
        request = MotionRequest.SLOW_DOWN if self.validity in TO_SLOW_DOWN else MotionRequest.NONE
        if is_stop or self.received.steering in TO_STOP:
            request = MotionRequest.STOP
        second = self.received.reception.second_sender(self.now_ns)
        error, status, state = map(self.freshness, LIMITS_NS)
        ages = (error, status, state)
        return ControllerSafety(refused, 0, *ages, self.fault, second, self.validity, request)

    def is_due(self, facts: ControllerSafety) -> bool:
        reported = self.reported
        if reported is None or facts == reported:
            return False
        is_worse = facts.fault is not reported.fault
        is_worse |= facts.motion_request > reported.motion_request
        is_worse |= any(newly_stale(facts, reported))
        return is_worse or self.now_ns - self.reported_ns >= INTERVAL_NS

    def live(self) -> None:
        """Let something happen, and compare."""
        random, received = self.random, self.received
        self.now_ns += random.choice(STEPS_NS)
        for _ in range(random.choice((0, 1, 2, 3))):
            self.receive(random.choice(tuple(LIMITS_NS)))
        if random.random() < 0.05:
            received.reception.take(encode(SteeringCommand(0.1, 1, Mode.ACTIVE), 0), self.now_ns)
        if random.random() < 0.05:
            received.unauthenticated += random.choice((1, 2, 4096))
        if random.random() < 0.1:
            received.steering = random.choice(tuple(SteeringStatusCode))
        if random.random() < 0.1:
            self.modes.goes_forward = random.random() < 0.7
        if random.random() < 0.05:
            self.modes.mode = random.choice(tuple(Mode))
        if random.random() < 0.05:
            self.fault = random.choice(tuple(ControllerFault))
        if random.random() < 0.1:
            self.judge()
        self.compare_received()
        if random.random() < 0.8 and self.now_ns >= self.first_tick_ns:
            self.tick()
        if random.random() < 0.1:
            self.send()

    def receive(self, kind: type[Message]) -> None:
        self.counters[kind] = (self.counters[kind] + self.random.choice((1, 1, 1, 1, 2, 0))) % 256
        frame = encode(MESSAGES[kind], self.counters[kind])
        if self.random.random() < 0.05:
            frame = frame._replace(data=frame.data[:-1])
        self.received.reception.take(frame, self.now_ns)

    def judge(self) -> None:
        speed_m_s = self.random.choice((0.5, 1.5, 2.5))
        delay_s = self.random.choice((None, 0.1, 0.3))
        fits_model = self.random.random() < 0.7
        self.received.vehicle = self.received.vehicle._replace(speed_m_s=speed_m_s)
        self.report.judge_validity(delay_s, fits_model=fits_model)
        is_seen = self.arrival_ns(VehicleState) is not None
        self.validity = Validity.SPEED_LOW if is_seen and speed_m_s == 0.5 else Validity.VALID
        if not fits_model:
            self.validity = Validity.MODEL_MISFIT
        if delay_s == 0.3:
            self.validity = Validity.DELAY_LONG
        if is_seen and speed_m_s == 2.5:
            self.validity = Validity.SPEED_HIGH

    def compare_received(self) -> None:
        received, now_ns = self.received, self.now_ns
        assert received.freshness(now_ns) == tuple(map(self.freshness, LIMITS_NS))
        received.wheel_rad = 0.3
        is_fresh = self.freshness(SteeringStatus) is Freshness.FRESH
        acting_rad = 0.3 if is_fresh and received.steering in OVERRULING else 0.7
        assert received.acting_rad(0.7, now_ns) == acting_rad
        is_old = self.freshness(VehicleState) is Freshness.STALE
        assert received.vehicle_at(now_ns).is_stale is (received.vehicle.is_stale or is_old)
        arrivals_ns = [ns for ns in map(self.arrival_ns, LIMITS_NS) if ns is not None]
        assert received.silence_ns(now_ns) == (now_ns - max(arrivals_ns) if arrivals_ns else 0)
        until_ns = [(self.arrival_ns(kind) or 0) + limit for kind, limit in LIMITS_NS.items()]
        assert received.fresh_until_ns() == min(until_ns)

    def tick(self) -> None:
        facts = self.facts()
        if self.before is not None:
            newly = newly_stale(facts, self.before)
            self.went_stale = [n + one for n, one in zip(self.went_stale, newly, strict=True)]
        self.before = facts
        assert self.report.on_tick(self.fault, self.now_ns) is self.is_due(facts)
        assert list(self.report.went_stale.values()) == self.went_stale

    def send(self) -> None:
        facts = self.facts()
        lost = self.received.reception.lost
        decoded = decode(self.report.frame(self.fault, self.now_ns))
        assert isinstance(decoded, Decoded)
        assert decoded.message == facts._replace(rejected=facts.rejected % 4096, lost=lost % 4096)
        self.reported, self.reported_ns = facts, self.now_ns


def newly_stale(facts: ControllerSafety, before: ControllerSafety) -> list[bool]:
    return [
        now is Freshness.STALE is not earlier
        for now, earlier in zip(facts[2:5], before[2:5], strict=True)
    ]


def test_random_lives_are_reported_as_the_rules_say() -> None:
    fresh = Received(SETTINGS)
    assert (fresh.lateral_error_m, fresh.heading_error_rad, fresh.wheel_rad) == (0.0, 0.0, 0.0)
    assert (fresh.refused, fresh.unauthenticated) == (0, 0)
    assert fresh.steering is SteeringStatusCode.NO_COMMAND
    for number in range(DRIVES):
        life = Life(Random(number))
        for _ in range(3):  # at one instant, which may be the first of all
            life.send()
            life.receive(LateralError)
        for _ in range(TICKS):
            life.live()
