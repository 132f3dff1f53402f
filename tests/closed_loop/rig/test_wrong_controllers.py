"""Controllers that are wrong in one way each are red, and the first line says why; right ones pass.

In virtual time, so that no busy machine decides: a good controller, and what is done to its frames.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.rig import Outcome, Rig
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, LateralError
from steer_by_wire.runtime.frame import Frame
from tests.support.attacks.wrong_controllers import RIGHT, WRONG, Change, Changed, late, steers
from tests.support.suite.combinations import sampled
from tests.support.suite.unrendered import unrendered as unrendered

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
    [
        ("half its rate", {"rate": False}),
        ("a tenth of its rate", {"rate": False}),
        ("twice its rate", {"rate": False}),
        ("floods", {"flood": False}),
    ],
)
def test_each_demand_on_its_conduct_is_switched_off_by_name(
    name: str, switches: Mapping[str, Any], wrong: Callable[[str], Outcome]
) -> None:
    wrong(name).assert_holds(**switches)


@pytest.mark.parametrize("preset", sampled(("practical_packet", "paper_pd"), RIGHT))
def test_a_right_controller_passes(preset: str, tmp_path: Path) -> None:
    sensor_ms, duration_s = (1.0, 4.0) if preset == "paper_pd" else (10.0, 8.0)
    overrides = {"duration_s": duration_s, "sensor_period_ms": sensor_ms}
    rig = Rig(tmp_path, overrides=overrides)
    rig.run(preset).assert_holds(rms_m=0.1)


def test_frames_that_are_passed_on_unchanged_pass(tmp_path: Path) -> None:
    driven(tmp_path, steers(lambda _n, rad: rad)).assert_holds(rms_m=0.1)


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
    if not by:
        outcome.assert_holds()
        return
    assert first_line(outcome).startswith("verdict: limit cycle: ")


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
