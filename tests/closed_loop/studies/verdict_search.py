"""Search for loops on which the verdict on runs disagrees with the linear analysis.

    python -m tests.closed_loop.studies.verdict_search --loops 2000

A loop is a law, its rate, its sensors' period, its gains, a vehicle, and one of the delays at which
``check`` finds its stability to begin or end. It runs for a minute 2 % below and 2 % above that
delay, each with the limits of commands that its preset has, and with limits that hardly bite. It is
to hold where the analysis says stable, and not to hold where it says unstable. With noise on the
lateral error it runs where it is unstable, and at half that delay if it is stable there: noise is
not to make an oscillation of it. Closer to the boundary noise alone drives a loop to its limits.
Noise that holds the rate of the commands at its limit also changes the loop, so that these runs are
counted and not demanded.

The analysis also gives the rate at which the slowest mode decays or grows, λ. The verdict compares
two windows of 15 s, and needs a mode that shows within the minute: the search counts its errors by
|λ|, which measures the band in which the verdict cannot tell. Nor can it where a law makes spikes
between two samples of the plant (``Asked.is_sparse``): ``run`` warns of those.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.studies.compiled_runs import verdict_on
from steer_by_wire.controller.analysis.check_figures import loop_around, stable_delays_of
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.node.report_in_words import sparse_measurements
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.evaluation.run_verdict import Verdict
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.settings import SettingsError
from tests.support.runs.unguarded import UNGUARDED

LAWS = (
    *("practical_pd", "practical_pd_dob", "practical_pd_cdob", "practical_pd_ddob"),
    *("practical_pid", "practical_smith"),
    *("paper_pd", "paper_pd_dob", "paper_pd_cdob", "paper_pd_ddob"),
    *("highway_pd", "highway_pd_ddob"),
)
RATES_HZ = (50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0)
SENSORS_MS = (1.0, 2.0, 4.0, 5.0, 10.0, 20.0)
TWO_RATES_SHARE = 0.03
"""Of the loops whose sensors and controller may have any two periods; analysing one takes 30 times
as long as a loop with a measurement at every tick, as does a law that looks back."""
LIMITS = {"own": (), "wide": ("limits.steer_rad_max=1.3", "limits.steer_rate_rad_s_max=1000")}
DURATION_S = 60.0
SHARES = (0.98, 1.02, 0.5)
"""Of the delay at which stability begins or ends."""
NOISES_M = (0.002, 0.02)
BAND_1_S = 0.03
"""Of |λ|, below which the verdict on a minute cannot tell."""
_DELAY_NS_MAX = 600_000_000
_TWO_RATES_PERIODS = 50
_IN_TRANSIT_MAX = 200
"""Commands on their way at the boundary: each is a state, and 600 of them take seconds."""


class DrawnLoop(NamedTuple):
    """A loop, a delay at which its stability begins or ends, and its decay at SHARES of it."""

    preset: str
    overrides: tuple[str, ...]
    speed_m_s: float
    virtual_mass_kg: float
    boundary_ns: int
    decays_1_s: tuple[float, ...]


class Asked(NamedTuple):
    """One run: what the analysis says, and the verdict.

    ``decay_1_s``  of the slowest mode; negative where one grows
    ``is_sparse``  whether the law differentiates measurements that are rarer than its ticks, and
                   has no filter: its commands are spikes between two samples of the plant
    """

    number: int
    preset: str
    limits: str
    noise_m: float
    delay_s: float
    decay_1_s: float
    is_sparse: bool
    verdict: Verdict
    overrides: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether both say the same. Noise may move a stable loop, but not make it oscillate."""
        if self.noise_m and self.decay_1_s > 0.0:
            return self.verdict not in (Verdict.UNSTABLE, Verdict.LIMIT_CYCLE)
        return (self.verdict is Verdict.HOLDS) == (self.decay_1_s > 0.0)


def drawn_loop(seed: int, number: int) -> DrawnLoop:
    """Draw a loop that has such a delay."""
    rng = np.random.default_rng([40, 2, seed, number])
    while True:
        found = _drawn(rng)
        if found is not None:
            return found


def _drawn(rng: np.random.Generator) -> DrawnLoop | None:
    preset = str(rng.choice(LAWS))
    own = controller_preset(preset)
    assert own.pd is not None
    rate_hz, sensor_ms = rng.choice(RATES_HZ), rng.choice(SENSORS_MS)
    has_two_rates = rng.random() < TWO_RATES_SHARE
    while not has_two_rates and (1000.0 / rate_hz) % sensor_ms:
        rate_hz, sensor_ms = rng.choice(RATES_HZ), rng.choice(SENSORS_MS)
    overrides = (
        f"rate_hz={rate_hz}",
        f"link.sensor_period_ms={sensor_ms}",
        f"pd.proportional_gain_rad_m={own.pd.proportional_gain_rad_m * _about_one(rng):.4f}",
        f"pd.derivative_gain_rad_s_m={own.pd.derivative_gain_rad_s_m * _about_one(rng):.4f}",
    )
    fast = preset.startswith("highway")
    speed_m_s = round(float(rng.uniform(8.0, 16.0) if fast else rng.uniform(1.0, 3.0)), 3)
    mass_kg = round(float(rng.uniform(1200.0, 5000.0)))
    try:
        settings = _settings(preset, overrides)
        loop = loop_around(settings, _nominal(speed_m_s, mass_kg), {})
        limit_ns = _DELAY_NS_MAX
        if settings.period_ns % settings.loop_delay.sensor_period_ns:
            limit_ns = min(limit_ns, _TWO_RATES_PERIODS * settings.period_ns)
        stable = stable_delays_of(loop, limit_ns)
    except (SettingsError, ValueError):
        return None
    ends = [end for one in stable for end in one if 5_000_000 < end < 0.98 * limit_ns]
    if not ends:
        return None
    boundary_ns = int(rng.choice(ends))
    if boundary_ns > _IN_TRANSIT_MAX * settings.period_ns:
        return None
    decays_1_s = tuple(loop.decay_1_s(round(share * boundary_ns)) for share in SHARES)
    if (decays_1_s[0] > 0.0) == (decays_1_s[1] > 0.0):
        return None  # the stretch beyond is shorter than 2 %
    return DrawnLoop(preset, overrides, speed_m_s, mass_kg, boundary_ns, decays_1_s)


def _about_one(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(-0.7, 0.7)))


def _settings(preset: str, overrides: Sequence[str]) -> ControllerSettings:
    return controller_preset(preset, tuple(overrides)).model_copy(update={"validity": None})


def _vehicle(speed_m_s: float, mass_kg: float) -> list[str]:
    return [f"vehicle.speed_m_s={speed_m_s}", f"vehicle.virtual_mass_kg={mass_kg}"]


def _nominal(speed_m_s: float, mass_kg: float) -> NominalVehicle:
    vehicle = plant_preset("paper_nominal", _vehicle(speed_m_s, mass_kg)).vehicle
    return NominalVehicle(**{name: getattr(vehicle, name) for name in NominalVehicle._fields})


def asked_of(seed: int, number: int) -> Iterator[Asked]:
    """Run one loop on both sides of its boundary, with either limits, and with noise."""
    drawn = drawn_loop(seed, number)
    facts = (*drawn.overrides, *_vehicle(drawn.speed_m_s, drawn.virtual_mass_kg))
    for place, (share, decay_1_s) in enumerate(zip(SHARES, drawn.decays_1_s, strict=True)):
        delay_s = round(share * drawn.boundary_ns) * 1e-9
        quiet, is_half = [(name, 0.0) for name in LIMITS], place == 2
        noisy = [("own", noise_m) for noise_m in NOISES_M]
        runs = [*([] if is_half else quiet), *(noisy if is_half == (decay_1_s > 0.0) else [])]
        for limits, noise_m in runs:
            settings = _settings(drawn.preset, (*drawn.overrides, *LIMITS[limits]))
            plant = _plant(drawn, settings, delay_s, noise_m)
            verdict = verdict_on(plant, settings, run_compiled(plant, settings))
            is_sparse = bool(sparse_measurements(settings, settings.link.sensor_period_s))
            of = (number, drawn.preset, limits, noise_m, delay_s, decay_1_s)
            yield Asked(*of, is_sparse, verdict, facts)


def _plant(
    drawn: DrawnLoop, settings: ControllerSettings, delay_s: float, noise_m: float
) -> PlantSettings:
    """Return a straight path on which a push of a second has to be corrected."""
    push_rad = round(0.05 * min(1.0, (1.4 / drawn.speed_m_s) ** 2), 5)
    pushed = f"{{at_s=0.5, steering_offset_rad={push_rad}}}, {{at_s=1.5, steering_offset_rad=0.0}}"
    plant = plant_preset(
        "paper_nominal",
        [
            *_vehicle(drawn.speed_m_s, drawn.virtual_mass_kg),
            f"duration_s={DURATION_S}",
            "path={kind='straight'}",
            f"sensor_period_ms={settings.link.sensor_period_ms}",
            f"latency.downlink.mean_s={delay_s!r}",
            f"disturbance.steps=[{pushed}]",
            f"sensor_noise.lateral_error_m={noise_m}",
            f"seed={drawn.boundary_ns % 1000}",
        ],
    )
    return plant.model_copy(update={"safety": UNGUARDED})


def is_told(one: Asked) -> bool:
    """Whether it is to agree: outside the band, without noise, and where samples show the wheel."""
    return abs(one.decay_1_s) >= BAND_1_S and not one.is_sparse and not one.noise_m


def main() -> int:
    """Search; returns 1 if a verdict outside the band is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.closed_loop.studies.verdict_search")
    parser.add_argument("--loops", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first loop")
    parser.add_argument("--out", type=Path, default=Path("out/verdict_search.jsonl"))
    options = parser.parse_args()
    asked: list[Asked] = []
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with options.out.open("w", encoding="utf-8") as file, suppress(KeyboardInterrupt):
        for number in range(options.first, options.first + options.loops):
            for one in asked_of(options.seed, number):
                asked.append(one)
                file.write(json.dumps(one._asdict()) + "\n")
            file.flush()
            if (number + 1) % 10 == 0:
                sys.stderr.write(f"{number + 1} loops, {len(wrong_of(asked))} wrong\n")
    sys.stdout.write("\n".join(summary(asked)) + "\n")
    return int(bool(wrong_of(asked)))


def wrong_of(asked: Sequence[Asked]) -> list[Asked]:
    """Return the runs whose verdict is wrong, outside of what it cannot tell."""
    return [one for one in asked if is_told(one) and not one.agrees]


def summary(asked: Sequence[Asked]) -> Iterator[str]:
    """Yield counts by noise and |λ|, and every wrong verdict outside the band."""
    edges = (0.0, 0.001, 0.003, 0.01, 0.02, 0.03, 0.05, 0.1, 0.3, np.inf)
    for noise_m in (0.0, *NOISES_M):
        yield f"noise of {1e3 * noise_m:g} mm"
        yield f"{'|λ| [1/s]':>16} {'runs':>6} {'false holds':>12} {'false alarms':>13}"
        for low, high in pairwise(edges):
            judged = (one for one in asked if not one.is_sparse and one.noise_m == noise_m)
            inside = [one for one in judged if low <= abs(one.decay_1_s) < high]
            wrong = [one for one in inside if not one.agrees]
            held = sum(one.verdict is Verdict.HOLDS for one in wrong)
            yield f"{low:>7g} to {high:<5g} {len(inside):>6} {held:>12} {len(wrong) - held:>13}"
    sparse = [one for one in asked if one.is_sparse]
    yield f"spikes between samples: {len(sparse)} runs, {sum(not o.agrees for o in sparse)} wrong"
    yield from (json.dumps(one._asdict()) for one in wrong_of(asked))


if __name__ == "__main__":
    sys.exit(main())
