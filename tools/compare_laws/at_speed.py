"""Laws on networks as they are, at walking speed and on the road: one lane change, many networks.

A lane change of 3.5 m, within 60 m at 30 and 60 km/h and within 20 m at 5 km/h, begins after 2 s of
straight road. The latency is that of the commands, and the steering's guard is on. Where a network
is random, all laws meet the same draws, and the worst of the seeds counts.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ...closed_loop.compiled.engine import Outcome, run_batch
from ...closed_loop.pair_result import rms
from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.settings import PlantSettings, plant_preset
from .runs import OFF_PATH_M, SETTLED_S, THREADS, constant, finished, jittery

DELAYS_S = (0.0, 0.1, 0.15, 0.2, 0.3, 0.4)
BROKEN_M = 0.5
"""Largest deviation of the preview point beyond which a law has lost the lane."""
_KNOWN_PATH = ("path_ahead={}",)


class Place(NamedTuple):
    """A speed, the plant's preset, the family of the laws' presets, and the lane change."""

    speed_km_h: float
    plant: str
    family: str
    length_m: float
    duration_s: float

    def overrides(self) -> list[str]:
        """Return what differs from the preset."""
        speed_m_s = self.speed_km_h / 3.6
        path = f"start_m={2.0 * speed_m_s}, offset_m=3.5, length_m={self.length_m}"
        return [
            f"vehicle.speed_m_s={speed_m_s}",
            f'path={{kind="single_lane_change", {path}}}',
            f"duration_s={self.duration_s}",
        ]


PLACES = (
    Place(5.0, "paper_nominal", "practical", 20.0, 20.0),
    Place(30.0, "highway_nominal", "highway", 60.0, 12.0),
    Place(60.0, "highway_nominal", "highway", 60.0, 10.0),
)
LAWS: Mapping[str, tuple[str, Sequence[str]]] = MappingProxyType(
    {
        "PD": ("pd", ()),
        "PD+DDOB": ("pd_ddob", ()),
        "predictor": ("predictor", ()),
        "predictor, path known": ("predictor", _KNOWN_PATH),
        "packet": ("packet", ()),
        "packet, path known": ("packet", _KNOWN_PATH),
    }
)
"""Preset of the place's family, and what the plant sends for it."""


class Network(NamedTuple):
    """Sets of overrides of the plant, of which the worst counts, at a mean latency [s]."""

    title: str
    overrides: Callable[[float], Sequence[Sequence[str]]]
    is_random: bool = False


def _ar1(delay_s: float) -> list[str]:
    return [*jittery(delay_s, "gamma", 0.4), "latency.downlink.correlation_time_s=0.5"]


def _bursts(delay_s: float) -> list[str]:
    return [*constant(delay_s), "latency.downlink.loss=0.25", "latency.downlink.burst_frames=15"]


def _masses(
    of: Callable[[float], Sequence[str]], *masses_kg: int
) -> Callable[[float], list[list[str]]]:
    return lambda delay_s: [
        [*of(delay_s), f"vehicle.virtual_mass_kg={mass_kg}"] for mass_kg in masses_kg
    ]


_AR1 = "gamma ± 40 %, correlated over 0.5 s, newest wins"
_BURSTS = "25 % lost in bursts of 15"
NETWORKS: Mapping[str, Network] = MappingProxyType(
    {
        "constant": Network("constant", lambda delay_s: [constant(delay_s)]),
        "ar1": Network(_AR1, lambda delay_s: [_ar1(delay_s)], is_random=True),
        "in_order": Network(
            "normal ± 30 %, in order",
            lambda delay_s: [[*jittery(delay_s), "latency.downlink.order=in_order"]],
            is_random=True,
        ),
        "bursts": Network(_BURSTS, lambda delay_s: [_bursts(delay_s)], is_random=True),
        "lag": Network(
            "constant, 20 ms of unknown steering lag",
            lambda delay_s: [[*constant(delay_s), "actuator.lag_s=0.02"]],
        ),
        "mass": Network("constant, 1600 and 5000 kg", _masses(constant, 1600, 5000)),
        **{
            f"{key}_{mass_kg}": Network(f"{title}, {mass_kg} kg", _masses(of, mass_kg), True)
            for key, title, of in (("ar1", _AR1, _ar1), ("bursts", _BURSTS, _bursts))
            for mass_kg in (1600, 5000)
        },
    }
)


class Cell(NamedTuple):
    """Worst figures of a law [m]: largest deviation and RMS of the whole run, RMS from 5 s on.

    Each of the preview point, and as ``*cg_*`` of the centre of gravity.
    """

    speed_km_h: float
    network: str
    law: str
    delay_s: float
    peak_m: float
    cg_peak_m: float
    rms_m: float
    cg_rms_m: float
    settled_rms_m: float
    settled_cg_rms_m: float


def compare_at_speed(
    delays_s: Sequence[float],
    seeds: int,
    progress: Callable[[int, int], None],
    laws: Sequence[str] = tuple(LAWS),
    places: Sequence[Place] = PLACES,
    should_stop: Callable[[], bool] = lambda: False,
) -> list[Cell]:
    """Return a cell for every speed, network, law and delay, or those before ``should_stop``."""
    asked = list(product(places, NETWORKS, laws, delays_s))
    with ThreadPoolExecutor(THREADS) as pool:
        futures = [pool.submit(_cell, *one, seeds) for one in asked]
        return finished(pool, futures, progress, should_stop)


def _cell(place: Place, key: str, law: str, delay_s: float, seeds: int) -> Cell:
    network = NETWORKS[key]
    suffix, sent = LAWS[law]
    controller = controller_preset(f"{place.family}_{suffix}")
    runs = range(1, (seeds if network.is_random else 1) + 1)
    figures = []
    for overrides, seed in product(network.overrides(delay_s), runs):
        changes = [*place.overrides(), *overrides, *sent, f"seed={seed}"]
        figures.append(_figures(plant_preset(place.plant, changes), controller))
    return Cell(place.speed_km_h, key, law, delay_s, *map(float, np.max(figures, axis=0)))


def _figures(rig: PlantSettings, controller: ControllerSettings) -> list[float]:
    """Return the last six fields of a cell, of one run."""
    run = run_batch(rig, controller)
    if run.outcome is not Outcome.COMPLETE:
        return [OFF_PATH_M] * 6
    both_m = (run.lateral_error_m, run.cg_deviation_m)
    is_settled = run.time_s >= SETTLED_S
    return [
        *(float(np.abs(deviation_m).max()) for deviation_m in both_m),
        *(rms(deviation_m) for deviation_m in both_m),
        *(rms(deviation_m[is_settled]) for deviation_m in both_m),
    ]


def breaks_at(cells: Sequence[Cell]) -> str:
    """Return the first delay [ms] at which a law has lost the lane, - for none."""
    broken_s = [cell.delay_s for cell in cells if cell.peak_m > BROKEN_M]
    return f"{1e3 * min(broken_s):.0f}" if broken_s else "-"


def markdown_at_speed(cells: Sequence[Cell]) -> Iterator[str]:
    """Yield a table for each speed: peaks by network and delay, RMS, and where each law breaks."""
    delays_s = sorted({cell.delay_s for cell in cells})
    for speed_km_h in dict.fromkeys(cell.speed_km_h for cell in cells):
        at_speed = [cell for cell in cells if cell.speed_km_h == speed_km_h]
        yield f"**{speed_km_h:g} km/h**, preview point / centre of gravity, largest deviation [m]"
        yield ""
        delays = " | ".join(f"{1e3 * delay_s:.0f} ms" for delay_s in delays_s)
        yield f"| Network | Law | {delays} | RMS [mm] | from 5 s on | breaks at [ms] |"
        yield "|---" * (5 + len(delays_s)) + "|"
        for key, law in dict.fromkeys((cell.network, cell.law) for cell in at_speed):
            own = [cell for cell in at_speed if (cell.network, cell.law) == (key, law)]
            peaks = " | ".join(f"{_in_m(cell.peak_m)} / {_in_m(cell.cg_peak_m)}" for cell in own)
            whole, settled = (
                " / ".join(
                    _in_mm(max(getattr(cell, name) for cell in own if cell.delay_s <= 0.2))
                    for name in names
                )
                for names in (("rms_m", "cg_rms_m"), ("settled_rms_m", "settled_cg_rms_m"))
            )
            title = NETWORKS[key].title
            yield f"| {title} | {law} | {peaks} | {whole} | {settled} | {breaks_at(own)} |"
        yield ""


def _in_m(value_m: float) -> str:
    return f"{value_m:.2f}" if value_m < 10.0 else "lost"


def _in_mm(value_m: float) -> str:
    return f"{1e3 * value_m:.0f}" if value_m < 10.0 else "lost"
