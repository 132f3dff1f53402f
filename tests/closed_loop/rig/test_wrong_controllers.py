"""Controllers that are wrong in one way each are red, and the first line says why; right ones pass.

In virtual time, so that no busy machine decides: a good controller, and what is done to its frames.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.rig import Outcome, Rig
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    LateralError,
    Rejection,
    SteeringCommand,
    decode,
    encode,
)
from steer_by_wire.runtime.frame import Frame
from tests.support.suite.combinations import sampled
from tests.support.suite.unrendered import unrendered as unrendered

SETTINGS = controller_preset("practical_pd_ddob", ["supervision.stops_if_implausible=false"])
"""Ours would notice that the wheel does not do what it commands, and stop."""
FOREIGN_ID = 0x7A1
Change = Callable[[int, SteeringCommand, int], Sequence[Frame]]
"""Returns what is sent in place of a command: its number, message and E2E counter."""


class Changed(ControllerNode):
    """A controller whose commands are changed before they are sent."""

    def __init__(
        self, start_ns: int, change: Change, settings: ControllerSettings = SETTINGS, **options: Any
    ) -> None:
        super().__init__(settings, start_ns, **options)
        self._change, self._number = change, -1

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        sent: list[Frame] = []
        for frame in super().on_tick(now_ns):
            if frame.can_id != CAN_IDS[SteeringCommand]:
                sent.append(frame)
                continue
            decoded = decode(frame)
            assert not isinstance(decoded, Rejection)
            assert isinstance(decoded.message, SteeringCommand)
            self._number += 1
            sent += self._change(self._number, decoded.message, decoded.counter)
        return sent


def steers(function: Callable[[int, float], float]) -> Change:
    """Return the change of the angle alone; ``function`` gets number and angle [rad]."""

    def change(number: int, command: SteeringCommand, counter: int) -> Sequence[Frame]:
        steer_rad = min(max(function(number, command.steer_rad), -1.0), 1.0)
        return [encode(command._replace(steer_rad=steer_rad), counter)]

    return change


def sends(is_sent: Callable[[int], bool]) -> Change:
    """Return the change that leaves out commands, and counts those that are sent."""
    count = 0

    def change(number: int, command: SteeringCommand, _counter: int) -> Sequence[Frame]:
        nonlocal count
        if not is_sent(number):
            return []
        count += 1
        return [encode(command._replace(command_counter=count), count % 256)]

    return change


def repeats(_number: int, command: SteeringCommand, _counter: int) -> Sequence[Frame]:
    return [encode(command._replace(command_counter=7), 7)]


def damages(_number: int, command: SteeringCommand, counter: int) -> Sequence[Frame]:
    frame = encode(command, counter)
    return [frame._replace(data=bytes([frame.data[0] ^ 1, *frame.data[1:]]))]


def doubles(number: int, command: SteeringCommand, _counter: int) -> Sequence[Frame]:
    pair = (2 * number, 2 * number + 1)
    return [encode(command._replace(command_counter=k), k % 256) for k in pair]


def floods(_number: int, command: SteeringCommand, counter: int) -> Sequence[Frame]:
    return [encode(command, counter), *[Frame(FOREIGN_ID, bytes(8))] * 3]


def late(by: int) -> Change:
    queue: list[float] = []

    def delayed(_number: int, steer_rad: float) -> float:
        queue.append(steer_rad)
        return queue.pop(0) if len(queue) > by else 0.0

    return steers(delayed)


NEVER = "the plant was never driven: no valid command arrived"
WRONG: Mapping[str, tuple[Callable[[], Change], str]] = {
    "silent": (lambda: sends(lambda _number: False), NEVER),
    "damaged CRC": (lambda: damages, NEVER),
    "silent from 3 s on": (lambda: sends(lambda n: n < 300), "the plant fell back: for "),
    "silent for a second": (lambda: sends(lambda n: n % 500 < 400), "the plant fell back: for "),
    "the same counter": (lambda: repeats, "the plant fell back: for "),
    "wrong sign": (lambda: steers(lambda _n, rad: -rad), "verdict: "),
    "always straight": (lambda: steers(lambda _n, _rad: 0.0), "verdict: "),
    "constant": (lambda: steers(lambda _n, _rad: 0.1), "verdict: "),
    "drifts": (lambda: steers(lambda n, rad: rad + 1e-3 * n), "verdict: "),
    "thirty times the gain": (lambda: steers(lambda _n, rad: 30.0 * rad), "verdict: "),
    "weak": (lambda: steers(lambda _n, rad: 0.02 * rad), "verdict: "),
    "saturates early": (lambda: steers(lambda _n, rad: min(max(rad, -0.02), 0.02)), "verdict: "),
    "late by 0.6 s": (lambda: late(60), "verdict: "),
    "shakes the wheel": (
        lambda: steers(lambda n, rad: rad + 0.15 * (1 if n // 10 % 2 else -1)),
        "verdict: limit cycle: ",
    ),
    "one side only": (lambda: steers(lambda _n, rad: min(rad, 0.0)), "verdict: "),
    "half its rate": (lambda: sends(lambda n: n % 2 == 0), "commands at 50 Hz instead of 100 Hz"),
    "a tenth of its rate": (lambda: sends(lambda n: n % 10 == 0), "commands at 10 Hz instead of "),
    "twice its rate": (lambda: doubles, "commands at 200 Hz instead of 100 Hz"),
    "floods": (lambda: floods, "floods the bus: 4"),
}

RIGHT = (
    *("practical_pd", "practical_pid", "practical_pd_cdob", "practical_pd_ddob"),
    *("practical_smith", "practical_predictor", "practical_packet", "paper_pd"),
)

pytestmark = pytest.mark.usefixtures("unrendered")
PLANT = {"duration_s": 10.0}


def driven(folder: Path, change: Change) -> Outcome:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("steer_by_wire.closed_loop.rig.rig.START_S_MAX", 3)
        return Rig(folder, overrides=PLANT).run(lambda start_ns: Changed(start_ns, change))


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Outcome]:
    """Return what came of one of WRONG, which is driven once."""
    return cache(lambda name: driven(tmp_path_factory.mktemp("wrong"), WRONG[name][0]()))


def first_line(outcome: Outcome, **switches: Any) -> str:
    with pytest.raises(AssertionError) as caught:
        outcome.assert_holds(**switches)
    return str(caught.value).splitlines()[0]


@pytest.mark.parametrize("name", sampled([*WRONG][::2], WRONG))
def test_a_wrong_controller_is_red(name: str, wrong: Callable[[str], Outcome]) -> None:
    assert first_line(wrong(name)).startswith(WRONG[name][1])


@pytest.mark.parametrize(
    ("name", "switches"),
    [("a tenth of its rate", {"rate": False}), ("floods", {"flood": False})],
)
def test_each_demand_on_its_conduct_is_switched_off_by_name(
    name: str, switches: Mapping[str, Any], wrong: Callable[[str], Outcome]
) -> None:
    wrong(name).assert_holds(**switches)


@pytest.mark.parametrize("preset", sampled(("practical_packet", "paper_pd"), RIGHT))
def test_a_right_controller_passes(preset: str, tmp_path: Path) -> None:
    sensor_ms, duration_s = (1.0, 4.0) if preset == "paper_pd" else (10.0, 8.0)
    rig = Rig(tmp_path, overrides={"duration_s": duration_s, "sensor_period_ms": sensor_ms})
    rig.run(preset).assert_holds(rms_m=0.1)


FAST = controller_preset(
    "practical_pd",
    [
        "pd.proportional_gain_rad_m=1.06",
        "pd.derivative_gain_rad_s_m=0.9",
        "pd.derivative_filter_rad_s=60",
    ],
)
"""Stable up to 25.3 ms of delay, of which the wait for the next tick takes 10 ms."""


@pytest.mark.parametrize("by", [0, 1])
def test_a_cycle_too_late_is_red_where_a_cycle_matters(by: int, tmp_path: Path) -> None:
    rig = Rig(tmp_path, overrides={**PLANT, "latency.downlink.mean_s": 0.012})
    outcome = rig.run(lambda start_ns: Changed(start_ns, late(by), FAST))
    if by:
        assert first_line(outcome).startswith("verdict: limit cycle: ")
    else:
        outcome.assert_holds()


class Startled(Changed):
    """Falls silent for good after 45 ms without a measurement."""

    _heard_ns = 0

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        if frame.can_id == CAN_IDS[LateralError] and self._heard_ns >= 0:
            is_gap = self._heard_ns and now_ns - self._heard_ns > 45_000_000
            self._heard_ns = -1 if is_gap else now_ns
        return super().on_frame(frame, now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        sent = super().on_tick(now_ns)
        return sent if self._heard_ns >= 0 else ()


def test_a_controller_that_fails_for_one_seed_is_red_for_that_alone(tmp_path: Path) -> None:
    red = []
    for seed in range(3):
        plant = {"duration_s": 8.0, "latency.uplink.loss": 0.18}
        rig = Rig(tmp_path / str(seed), overrides=plant, seed=seed)
        outcome = rig.run(lambda start_ns: Startled(start_ns, steers(lambda _n, rad: rad)))
        if outcome.report["safety"]["fallbacks"]:
            assert first_line(outcome).startswith("the plant fell back: for ")
            red.append(seed)
        else:
            outcome.assert_holds()
    assert len(red) == 1


@pytest.mark.parametrize("ignored", ["TERM", "TERM INT"])
def test_a_program_that_does_not_end_is_named(ignored: str, tmp_path: Path) -> None:
    moves = {"duration_s": 1.0, "start_on_first_command": False}
    outcome = Rig(tmp_path, overrides=moves, bus="emulated").run(
        ["sh", "-c", f"trap '' {ignored}; exec sleep 60"]
    )
    assert first_line(outcome) == "the controller did not end within 3 s of SIGTERM"
    outcome.assert_holds(end=False)  # a second without a command, on the way it had
