"""The runs of the comparison: law by network by delay by corner of the box, compiled.

RMS of the preview point's lateral error and of the deviation of the centre of gravity (CG), worst
over the corners of SAE 2018-01-1086, Figure 2 (4 and 7 km/h, 1600 and 5000 kg), on an ellipse of 60
by 30 m, which begins where it bends most. The latency is that of the commands; where it is random,
all laws meet the same draws.

The effect of jitter depends on the order of arrival. Where the newest command wins, the one in
effect has overtaken others and is younger than the mean. In order, as on one wire behind a queue, a
late command holds up all behind it, and the one in effect is older than the mean.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import product
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from ...closed_loop.compiled.engine import Outcome, run_batch
from ...closed_loop.pair_result import rms
from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.settings import PlantSettings, plant_preset
from ...plant_emulator.steering.settings import UNGUARDED

CORNERS = ("a", "b", "c", "d")
PATH = 'path={kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}'
LAG_S = 0.27
"""Lag of the steering actuator in Autoware's simulator, which comes with a delay of 0.24 s."""
SETTLED_S = 5.0
BROKEN_M = 0.1
"""RMS of its followed point beyond which a law does not hold the path: it is in a limit cycle, or
worse."""
OFF_PATH_M = 1e3
THREADS = 2

One = TypeVar("One")


class Contestant(NamedTuple):
    """A law of the comparison: a preset and the settings that differ from it.

    ``with_lag``       further changes where the actuator lags, if the law can allow for the lag
    ``is_continuous``  written for continuous time: 1 kHz, sensors too, and a constant delay only
    ``follows_cg``     whether it holds the CG on the path, and not the preview point
    """

    label: str
    preset: str
    overrides: tuple[str, ...] = ()
    with_lag: tuple[str, ...] = ()
    is_continuous: bool = False
    follows_cg: bool = False


_FOLLOW_CG = "followed_point=centre_of_gravity"
CONTESTANTS = (
    Contestant("PD as published", "paper_pd", is_continuous=True),
    Contestant("PD+DOB as published", "paper_pd_dob", is_continuous=True),
    Contestant("PD", "practical_pd"),
    Contestant("PD + map curvature", "practical_pd", ("feed_forward={}",)),
    Contestant("PD+DOB", "practical_pd_dob"),
    Contestant("PD+CDOB", "practical_pd_cdob"),
    Contestant("PD+DDOB", "practical_pd_ddob"),
    Contestant("PD+DDOB, long delay", "practical_long_delay_pd_ddob"),
    Contestant("PD+DDOB, half a second", "practical_half_second_pd_ddob"),
    Contestant("Smith predictor", "practical_smith"),
    Contestant("delayed set point", "practical_delayed_set_point"),
    Contestant("predictor", "practical_predictor"),
    Contestant(
        "predictor, lag known",
        "practical_predictor",
        with_lag=(f"estimator.actuator_lag_s={LAG_S}",),
    ),
    Contestant("PD+DDOB, CG", "practical_pd_ddob", (_FOLLOW_CG,), follows_cg=True),
    Contestant("predictor, CG", "practical_predictor", (_FOLLOW_CG,), follows_cg=True),
)


class Network(NamedTuple):
    """Overrides of the plant for a mean latency [s]; ``short`` is the title of a column."""

    title: str
    short: str
    overrides: Callable[[float], Sequence[str]]
    has_lag: bool = False
    is_random: bool = False


def constant(delay_s: float) -> list[str]:
    """Return the overrides of a constant latency."""
    return [f"latency.downlink.mean_s={delay_s}"]


def jittery(delay_s: float, model: str = "normal", share: float = 0.3) -> list[str]:
    """Return the overrides of a latency whose standard deviation is a share of its mean."""
    spread = f"latency.downlink.spread_s={share * delay_s}"
    return [*constant(delay_s), f"latency.downlink.model={model}", spread]


NETWORKS: Mapping[str, Network] = MappingProxyType(
    {
        "constant": Network("constant delay", "constant", constant),
        "jitter": Network(
            "standard deviation 30 %, newest wins", "± 30 %, newest wins", jittery, is_random=True
        ),
        "in_order": Network(
            "standard deviation 30 %, in order",
            "± 30 %, in order",
            lambda delay_s: [*jittery(delay_s), "latency.downlink.order=in_order"],
            is_random=True,
        ),
        "loss": Network(
            "5 % lost, both ways",
            "5 % lost",
            lambda delay_s: [
                *constant(delay_s),
                "latency.downlink.loss=0.05",
                "latency.uplink.loss=0.05",
            ],
            is_random=True,
        ),
        "lag": Network(
            f"constant, behind an actuator lag of {LAG_S:g} s",
            f"lag {LAG_S:g} s",
            lambda delay_s: [*constant(delay_s), f"actuator.lag_s={LAG_S}"],
            has_lag=True,
        ),
    }
)


class Cell(NamedTuple):
    """Worst RMS over corners and seeds [m].

    ``rms_m``, ``settled_rms_m``  of the preview point, from the start and from ``SETTLED_S`` on
    ``cg_rms_m``, ``settled_cg_rms_m``  the same of the CG
    """

    contestant: str
    network: str
    delay_s: float
    follows_cg: bool
    rms_m: float
    settled_rms_m: float
    cg_rms_m: float
    settled_cg_rms_m: float

    @property
    def followed_m(self) -> tuple[float, float]:
        """RMS of the point that the law holds on the path, settled and from the start."""
        if self.follows_cg:
            return self.settled_cg_rms_m, self.cg_rms_m
        return self.settled_rms_m, self.rms_m


def own_contestant(law: str, overrides: Sequence[str]) -> Contestant:
    """Return a law of another package, with the tables of a preset that has them all."""
    return Contestant(law, "practical_pd_ddob", (*overrides, f"law={law}"))


def contestants_of(network: Network, further: Sequence[Contestant] = ()) -> list[Contestant]:
    """Return the contestants of a network; some take part in one only."""
    everyone = (*CONTESTANTS, *further)
    return [
        one
        for one in everyone
        if (network.has_lag or not one.with_lag)
        and (network is NETWORKS["constant"] or not one.is_continuous)
    ]


def compare(
    delays_s: Sequence[float],
    seeds: int,
    duration_s: float,
    progress: Callable[[int, int], None],
    further: Sequence[Contestant] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> list[Cell]:
    """Return a cell for every network, contestant and delay, or those before ``should_stop``.

    ``progress``  is called with the number of cells computed, and of all
    """
    asked = [
        (key, one, delay_s)
        for key, network in NETWORKS.items()
        for one, delay_s in product(contestants_of(network, further), delays_s)
    ]
    with ThreadPoolExecutor(THREADS) as pool:
        futures = [pool.submit(cell_of, *one, seeds, duration_s) for one in asked]
        return finished(pool, futures, progress, should_stop)


def finished(
    pool: ThreadPoolExecutor,
    futures: Sequence[Future[One]],
    progress: Callable[[int, int], None],
    should_stop: Callable[[], bool],
) -> list[One]:
    """Return the results in their order, or those before ``should_stop``.

    ``progress``  is called with the number of results, and of all
    """
    results = []
    for future in futures:
        results.append(future.result())
        progress(len(results), len(futures))
        if should_stop():
            pool.shutdown(cancel_futures=True)
            break
    return results


def controller_settings(one: Contestant, *, has_lag: bool) -> ControllerSettings:
    """Return the settings of a contestant."""
    overrides = (*one.overrides, *(one.with_lag if has_lag else ()))
    return controller_preset(one.preset, overrides)


def plant_settings(
    network: Network,
    delay_s: float,
    corner: str,
    seed: int,
    duration_s: float,
    is_continuous: bool = False,
) -> PlantSettings:
    """Return the settings of a rig."""
    overrides = [f"seed={seed}", f"duration_s={duration_s}", PATH, *network.overrides(delay_s)]
    if is_continuous:
        overrides.append("sensor_period_ms=1")
    settings = plant_preset(f"paper_corner_{corner}", overrides)
    return settings.model_copy(update={"safety": UNGUARDED})


def cell_of(key: str, one: Contestant, delay_s: float, seeds: int, duration_s: float) -> Cell:
    """Return the cell of a network (a key of NETWORKS), a contestant and a mean delay."""
    network = NETWORKS[key]
    controller = controller_settings(one, has_lag=network.has_lag)
    figures = [
        figures_m(
            plant_settings(network, delay_s, corner, seed, duration_s, one.is_continuous),
            controller,
        )
        for seed in range(1, (seeds if network.is_random else 1) + 1)
        for corner in CORNERS
    ]
    worst = np.max(figures, axis=0)
    return Cell(one.label, key, delay_s, one.follows_cg, *map(float, worst))


def figures_m(plant: PlantSettings, controller: ControllerSettings) -> list[float]:
    """Return the last four fields of a cell, of one run [m]."""
    run = run_batch(plant, controller)
    if run.outcome is not Outcome.COMPLETE:
        return [OFF_PATH_M] * 4
    is_settled = run.time_s >= SETTLED_S
    return [
        rms(part_m)
        for deviation_m in (run.lateral_error_m, run.cg_deviation_m)
        for part_m in (deviation_m, deviation_m[is_settled])
    ]


def breaks_at_s(cells: Sequence[Cell]) -> float | None:
    """Return the first delay at which a law does not hold the path, None if at none."""
    broken = [cell.delay_s for cell in cells if cell.followed_m[0] > BROKEN_M]
    return min(broken, default=None)
