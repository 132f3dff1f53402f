"""Print what intruders without a key cost beyond silence, behind jitter and at speed.

    python -m tests.soak.forged_strategies [--of "highway_pd, ideal"]
    python -m tests.soak.forged_strategies --draws 100 [--seed 1] [--of "60 km/h, highway_pd"]

Every strategy of ``tests.system.test_second_senders`` runs for two seconds in virtual time, against
measurements and against commands. A line has the largest lateral error of the worst strategy and,
before it, that of silence: the worse one of the two, for as long, and for the pause longer that a
node makes after a frame of its own (``reception.PAUSE_NS``). Takes about ten minutes.

With ``--draws``, strategies are drawn instead: of each message one forged frame, two, a burst, or a
second's stream, of any value, sign, counter and time: on a straight, in a lane change, at the start
and behind a silence of 200 ms. A line has the worst of its kind, as ``Attack`` takes it; silence
is as long. Takes about ten minutes per hundred draws for each law.
"""

import argparse
import math
import random
import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import LateralError, Message, SteeringCommand, limits
from steer_by_wire.dbc.reception import PAUSE_NS
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from tests.support.attacks.forged_counters import PERIOD_NS, Shot
from tests.support.attacks.intruder import Attack, drive
from tests.system.test_second_senders import ATTACK_NS, STRATEGIES

KINDS: tuple[type[Message], ...] = (LateralError, SteeringCommand)
HIGHWAY = ("highway_predictor", "highway_pd", "highway_pd_ddob")


class Case(NamedTuple):
    """A pair on a network, attacked from ``onset_s`` on; ``values`` are of KINDS [m], [rad]."""

    plant: PlantSettings
    controller: ControllerSettings
    onset_s: float
    values: tuple[float, float]


def jitter(mean_s: float, spread_s: float) -> list[str]:
    """Return settings of an uplink that lets measurements overtake."""
    line = {"mean_s": mean_s, "spread_s": spread_s, "model": "normal"}
    return [f"latency.uplink.{key}={value}" for key, value in line.items()]


def cases() -> Iterator[tuple[str, Case]]:
    """Yield the cases by their names: the default path at 5 km/h, a lane change at 60 km/h."""
    networks = {"ideal": [], "80 ± 30 ms": jitter(0.08, 0.03), "160 ± 50 ms": jitter(0.16, 0.05)}
    slow = controller_preset("practical_pd_ddob")
    for name, network in networks.items():
        plant = PlantSettings(
            duration_s=6.0, latency=plant_preset("paper_nominal", network).latency
        )
        yield f"5 km/h, {name}", Case(plant, slow, 2.0, (0.2, 0.6))
    for name in HIGHWAY:
        plant = plant_preset("highway_corner_d", ["duration_s=17"])
        yield f"{name}, ideal", Case(plant, controller_preset(name), 12.75, (1.0, -0.6))


def lines(name: str, case: Case) -> Iterator[str]:
    """Yield the lines of a case."""
    plant, controller, onset_s, values = case
    onset_ns = round(onset_s * NS_PER_S)
    silences_m = [
        max(drive(plant, controller, Attack(kind, 0.0, onset_ns, ns)).peak_m for kind in KINDS)
        for ns in (ATTACK_NS, ATTACK_NS + PAUSE_NS)
    ]
    for kind, value in zip(KINDS, values, strict=True):
        costs_m = {
            strategy: drive(
                plant, controller, Attack(kind, value, onset_ns, ATTACK_NS, shots, repeats)
            ).peak_m
            for strategy, (shots, repeats) in STRATEGIES.items()
        }
        worst = max(costs_m, key=lambda strategy: costs_m[strategy])
        found = "".join(f"{each_m:9.2f}" for each_m in (*silences_m, costs_m[worst]))
        yield f"{name:25} {kind.__name__:16}{found}  {worst}"


SLOW = ("pd", "pd_dob", "pd_cdob", "pd_ddob", "pid", "predictor", "packet", "smith")
RANGES = (limits(LateralError)["lateral_error_m"], limits(SteeringCommand)["steer_rad"])
FRAMES = ("one", "two", "burst", "stream")


class Road(NamedTuple):
    """A pair on a road, and when an attack may begin: any of these intervals [s]."""

    plant: PlantSettings
    controller: ControllerSettings
    onsets_s: Sequence[tuple[float, float]]


def roads() -> Iterator[tuple[str, list[Road]]]:
    """Yield what drawn strategies are tried on, by law and speed."""
    lost = "magnitude=1.0, onset_s=1.0, duration_s=0.2"
    gaps = [
        f'faults=[{{kind="drop", message="{name}", direction="{way}", {lost}}}]'
        for name, way in (("LATERAL_ERROR", "uplink"), ("STEERING_COMMAND", "downlink"))
    ]
    for law in SLOW:
        found = []
        for settings in ([], *([gap] for gap in gaps)):
            plant = plant_preset("paper_nominal", ["duration_s=5", *settings])
            onsets_s = [(0.02, 0.3), (1.0, 3.5)] if not settings else [(1.19, 1.4)]
            found.append(Road(plant, controller_preset(f"practical_{law}"), onsets_s))
        yield f"5 km/h, practical_{law}", found
    for name in HIGHWAY:
        controller, straight = controller_preset(name), ['path={kind="straight"}', "duration_s=5"]
        found = [Road(plant_preset("highway_corner_d", straight), controller, [(0.02, 2.5)])]
        for gap in gaps:
            settings = [*straight, gap]
            found.append(
                Road(plant_preset("highway_corner_d", settings), controller, [(1.19, 1.4)])
            )
        lane = plant_preset("highway_corner_d", ["duration_s=17"])
        found.append(Road(lane, controller, [(8.0, 13.5)]))
        yield f"60 km/h, {name}", found


def drawn(rng: random.Random, road: Road, kind: type[Message], frames: str) -> Attack:
    """Draw a strategy."""
    highest = RANGES[KINDS.index(kind)].maximum
    value = rng.choice((-1.0, 1.0)) * highest * math.exp(-rng.uniform(0.0, 7.0))
    onset_ns = round(rng.uniform(*rng.choice(road.onsets_s)) * NS_PER_S)

    def shot() -> Shot:
        after_ns = rng.choice((100_000, 9_900_000, rng.randrange(30 * NS_PER_MS)))
        return Shot(after_ns, rng.choice((1, 2, 3, 5, 16, 30, 31, 32, 60, 100, -3, -60)))

    if frames == "stream":
        shots = [[shot() for _ in range(rng.randrange(3))] for _ in range(rng.randrange(1, 6))]
        return Attack(kind, value, onset_ns, NS_PER_S, [[shot()], *shots])
    if frames == "burst":
        first, step = rng.choice((1, 2, 16)), rng.choice((1, 1, 2, 3))
        burst = [Shot(100_000, first + step * each) for each in range(rng.randrange(3, 17))]
        return Attack(kind, value, onset_ns, PERIOD_NS, [burst], repeats=False)
    shots = [[shot()]]
    if frames == "two":
        shots += [[] for _ in range(rng.choice((0, 1, 4, 20)))] + [[shot()]]
    return Attack(kind, value, onset_ns, len(shots) * PERIOD_NS, shots, repeats=False)


def silence_m(road: Road, like: Attack) -> float:
    """Return what the worse silence costs, begun with an attack and as long; no less than none."""
    attacks = [like._replace(kind=kind, shots=()) for kind in KINDS]
    return max(drive(road.plant, road.controller, attack).peak_m for attack in attacks)


def drawn_lines(name: str, found: Sequence[Road], draws: int, seed: int) -> Iterator[str]:
    """Yield the worst strategy of each message and number of frames."""
    for kind in KINDS:
        for frames in FRAMES:
            rng, worst = random.Random(f"{seed} {name} {kind} {frames}"), (-math.inf, "")
            for _ in range(-(-draws // (len(KINDS) * len(FRAMES)))):
                road = rng.choice(found)
                attack = drawn(rng, road, kind, frames)
                peak_m = drive(road.plant, road.controller, attack).peak_m
                if peak_m < worst[0]:  # silence costs 0 or more
                    continue
                beyond_m = peak_m - silence_m(road, attack)
                where = f"{road.plant.path.kind}, {len(road.plant.faults)} faults"
                worst = max(worst, (beyond_m, f"{where}, {attack[1:]}"))
            yield f"{name:26} {kind.__name__:16} {frames:6} {worst[0]:+8.3f}  {worst[1]}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    known, drawn_on = dict(cases()), dict(roads())
    parser = argparse.ArgumentParser(prog="python -m tests.soak.forged_strategies")
    parser.add_argument("--draws", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--of", nargs="+", choices=[*known, *drawn_on])
    asked = parser.parse_args(arguments)
    console = plain_console()
    if asked.draws:
        console.print("beyond silence [m], and with which value, onset, length and shots")
        for name in asked.of or drawn_on:
            for line in drawn_lines(name, drawn_on[name], asked.draws, asked.seed):
                console.print(line)
        return 0
    console.print(f"{'largest error [m] with':42}  silence  + pause   forged  worst strategy")
    for name in asked.of or known:
        for line in lines(name, known[name]):
            console.print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
