"""The mode table: random drives against a table written apart."""

from random import Random

from steer_by_wire.controller.node import modes
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import Mode

TIMEOUT_NS, HOLD_NS, RECOVERY = 30, 50, 3
STEPS_NS = (0, 1, 1, 1, 5, 5, 10, 30, 31, 50)
DRIVES, TICKS = 200, 40


class Told:
    """The modes as the documents tell them, found anew from all that has happened."""

    def __init__(self) -> None:
        self.mode, self.since_ns = Mode.WAITING, 0
        self.good: list[int] = []  # since HOLDING began: 1 good, -1 damaged, 0 a gap
        self.newest_ns: int | None = None
        self.goes_forward, self.at_fault = True, False

    def run(self) -> int:
        run = 0
        for one in self.good:
            run = 1 if one == 0 else max(run + one, 0)
        return run

    def measured(self, now_ns: int) -> None:
        is_gap = self.newest_ns is None or now_ns > self.newest_ns + TIMEOUT_NS
        self.good.append(0 if is_gap else 1)
        self.newest_ns = now_ns

    def is_fresh(self, now_ns: int) -> bool:
        return self.newest_ns is not None and self.newest_ns + TIMEOUT_NS >= now_ns

    def may_stay(self, now_ns: int) -> bool:
        drives = self.goes_forward and not self.at_fault
        return self.mode is Mode.ACTIVE and drives and self.is_fresh(now_ns)

    def follow(self, now_ns: int, *, law_failed: bool) -> Mode | None:
        fresh = self.is_fresh(now_ns)
        back = fresh and self.run() >= RECOVERY and self.goes_forward and not self.at_fault
        found = self.mode
        if self.mode is Mode.WAITING:
            found = Mode.ACTIVE if fresh else found
        elif self.mode is Mode.ACTIVE:
            if law_failed or not fresh or not self.goes_forward:
                found = Mode.HOLDING
            found = Mode.SAFE_STOP if self.at_fault else found
        elif back:
            found = Mode.ACTIVE
        elif self.mode is Mode.HOLDING and (self.at_fault or now_ns >= self.since_ns + HOLD_NS):
            found = Mode.SAFE_STOP
        if found is self.mode:
            return None
        self.mode, self.since_ns = found, now_ns
        if found is Mode.HOLDING:
            self.good.clear()
        return found


def drive(random: Random) -> None:
    """Drive both through the same events, and compare them at every tick."""
    supervisor = modes.Supervisor(modes.Supervision(TIMEOUT_NS, HOLD_NS, RECOVERY), 0)
    told, now_ns = Told(), 0
    for _ in range(TICKS):
        now_ns += random.choice(STEPS_NS)
        for _ in range(random.choice((0, 1, 1, 1, 2))):
            if random.random() < 0.2:
                supervisor.on_rejection()
                told.good.append(-1)
            else:
                supervisor.on_measurement(told.newest_ns, now_ns)
                told.measured(now_ns)
            now_ns += random.choice((0, 0, 0, 1, 30, 31))
        if random.random() < 0.1:
            supervisor.goes_forward = told.goes_forward = random.random() < 0.7
        if random.random() < 0.01:
            supervisor.has_own_fault = True
            told.at_fault = True
        law_failed = random.random() < 0.05
        assert supervisor.stays_active(told.newest_ns, now_ns) == told.may_stay(now_ns)
        entered = told.follow(now_ns, law_failed=law_failed)
        assert supervisor.move_on(told.newest_ns, now_ns, law_failed=law_failed) is entered
        assert supervisor.mode is told.mode


def test_drives_follow_the_mode_table() -> None:
    """Check the settings' way to the table, and drives."""
    settings = controller_preset("practical_pd_ddob")
    table = settings.supervision
    assert modes.supervision_of(settings) == (
        settings.age_limits.lateral_error_ns,
        round(1e6 * table.hold_ms),
        table.recovery_frames,
    )
    for number in range(DRIVES):
        drive(Random(number))
