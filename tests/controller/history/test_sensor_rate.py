"""A sensor period that is not the setting's is noticed by the counter of the measurements."""

import random
from collections.abc import Callable, Iterable, Sequence

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.controller.command_line import program
from steer_by_wire.controller.history.sensor_rate import NO_RATE, RateState, rate_step
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.node.node import PlantNode
from tests.support.runs.compiled_runs import assert_same_as_nodes, plant_settings

MS = 1_000_000


class Clock:
    """Holds samples against the clock, each with its arrival in ms."""

    def __init__(self, period_ns: int = 10 * MS) -> None:
        self.rate = NO_RATE
        self._period_ns = period_ns
        self._newest_ns = 0

    def sample(self, number: int, arrival_ms: float) -> None:
        before_ns, self._newest_ns = self._newest_ns, round(arrival_ms * MS)
        self.rate = rate_step(self._period_ns, self.rate, before_ns, number, self._newest_ns)


def after(arrivals: Iterable[tuple[int, float]], period_ms: float = 10.0) -> RateState:
    """The state after samples, each with its arrival in ms."""
    clock = Clock(round(period_ms * MS))
    for sample, arrival_ms in arrivals:
        clock.sample(sample, arrival_ms)
    return clock.rate


def every(
    period_ms: float, seconds: float = 10.0, late_ms: Callable[[], float] = lambda: 0.0
) -> list[tuple[int, float]]:
    """Arrivals at a period, of which the newest wins."""
    sent = range(round(seconds * 1e3 / period_ms))
    came = sorted((sample * period_ms + late_ms(), sample) for sample in sent)
    rising, newest = [], -1
    for arrival_ms, sample in came:
        if sample > newest:
            rising.append((sample, arrival_ms))
            newest = sample
    return rising


@pytest.mark.parametrize("real_ms", [1.0, 5.0, 8.2, 12.2, 20.0, 100.0])
def test_a_period_that_is_off_by_more_than_a_fifth_is_found_within_five_seconds(
    real_ms: float,
) -> None:
    found = after(every(real_ms, 5.5))
    assert found.is_wrong
    assert found.measured_ns == pytest.approx(real_ms * MS, rel=0.02)


@pytest.mark.parametrize("deviation_ms", [30.0, 90.0])
@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_jitter_and_loss_are_no_wrong_period(deviation_ms: float, lost: float) -> None:
    source = random.Random(3)
    arrivals = every(10.0, 300.0, lambda: max(0.0, source.gauss(300.0, deviation_ms)))
    clock = Clock()
    for sample, arrival_ms in arrivals:
        if source.random() >= lost:
            clock.sample(sample, arrival_ms)
            assert not clock.rate.is_wrong


def test_a_latency_that_rises_and_falls_by_half_a_second_is_no_wrong_period() -> None:
    clock = Clock()
    for sample in range(6000):
        latency_ms = 500.0 * abs((sample / 300) % 2 - 1)  # in three seconds
        clock.sample(sample, sample * 10.0 + latency_ms)
        assert not clock.rate.is_wrong


def test_a_period_that_comes_right_is_believed_again() -> None:
    wrong = every(20.0, 6.0)
    sample, at_ms = wrong[-1]
    right = [(sample + n, at_ms + 10.0 * n) for n in range(1, 500)]
    assert after([*wrong, *right[:350]]).is_wrong
    assert not after([*wrong, *right]).is_wrong


def driven(
    overrides: Sequence[str], law: Sequence[str] = (), duration_s: float = 12.0
) -> tuple[PlantNode, ControllerNode]:
    plant = plant_settings(
        ["path.kind=ellipse", "path.semi_major_axis_m=60", "path.semi_minor_axis_m=30", *overrides],
        duration_s=duration_s,
    )
    nodes = (PlantNode(plant, 0), ControllerNode(controller_preset("practical_predictor", law), 0))
    run_virtual_nodes(*nodes, None, None, lambda: False)
    return nodes


LONG = ("latency.downlink.mean_s=0.244", "latency.uplink.mean_s=0.05")


def test_the_predictor_does_without_a_delay_that_is_counted_in_wrong_periods() -> None:
    """It needs four seconds to notice, and steers wrongly until then; the fallback recovers."""
    plant, controller = driven([*LONG, "sensor_period_ms=20"], duration_s=30.0)
    seen = controller.report()["sensor_period"]
    assert seen["times_wrong"] == 1
    assert seen["measured_s"] == pytest.approx(0.02, rel=0.05)
    assert max(abs(each.cg_deviation_m) for each in plant.samples[-500:]) < 0.01
    right = driven([*LONG, "sensor_period_ms=20"], ["link.sensor_period_ms=20"])[1]
    assert right.report()["sensor_period"] == {
        "setting_s": 0.02,
        "times_wrong": 0,
        "measured_s": None,
    }


def test_laws_that_do_not_ask_for_the_period_are_not_reported() -> None:
    node = ControllerNode(controller_preset("practical_pd", ("followed_point=preview",)), 0)
    assert node.report()["sensor_period"] is None


@pytest.mark.parametrize(
    ("law", "period_ms", "is_warned"),
    [("paper_pd", "10", True), ("paper_pd", "1", False), ("practical_pd", "20", False)],
)
def test_measurements_too_rare_for_an_unfiltered_derivative_are_warned_of(
    law: str, period_ms: str, is_warned: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = controller_preset(law)
    plant = PlantNode(plant_settings([f"sensor_period_ms={period_ms}"], 1.0), 0)
    node = ControllerNode(settings, 0)
    run_virtual_nodes(plant, node, None, None, lambda: False)
    program.conclude(settings, node)
    warned = capsys.readouterr().err
    assert ("make this another law" in warned) is is_warned
    assert not is_warned or "for a control period of 1 ms" in warned


def test_a_wrong_period_is_said_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    for period, lines in (("20", 1), ("10", 0)):
        _, controller = driven([f"sensor_period_ms={period}"])
        program.conclude(controller_preset("practical_predictor"), controller)
        said_lines = capsys.readouterr().out.splitlines()
        reported = [line for line in said_lines if "warning" in line]
        assert len(reported) == lines
        said = "sensor period was about 20 ms, but link.sensor_period_ms = 10"
        assert all(said in line for line in reported)


@pytest.mark.parametrize(
    "overrides",
    [
        [*LONG, "sensor_period_ms=20"],
        ["sensor_period_ms=5", "latency.uplink.loss=0.3", "latency.downlink.mean_s=0.1"],
        [
            "sensor_period_ms=12.3",
            *("latency.uplink.model=gamma", "latency.uplink.mean_s=0.1"),
            "latency.uplink.spread_s=0.05",
        ],
    ],
    ids=["slow", "fast", "jitter"],
)
def test_a_compiled_run_notices_it_at_the_same_tick(overrides: Sequence[str]) -> None:
    plant = plant_settings(overrides, duration_s=8.0)
    assert_same_as_nodes(plant, controller_preset("practical_predictor"))
