"""Print forged frames that are followed against false stops, for the rules' constants.

    python -m tests.soak.forged_frames [--strategies 12] [--seed 1]

    run    frames of another stream that show a second sender (``SequenceRule.resync_run``):
           forged measurements followed after an absence of the true sender, the most of 60 times as
           many strategies, against the longest time without a frame in use after 1 to 4 stray ones
    pause  after a node's own identifier (``reception.PAUSE_NS``): cost of two seconds of forged
           commands and measurements beyond the worse silence, against holds after 1 and 2 strays

Takes about two minutes.
"""

import argparse
import random
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise, product

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc import reception
from steer_by_wire.dbc.codec.sequence_and_second_sender import CHANGING, SequenceRule
from steer_by_wire.dbc.messages import LateralError, Message, SteeringCommand
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from tests.support.attacks.forged_counters import ALONE, Absence, Shot, followed_after, hear
from tests.support.attacks.intruder import Attack, drive

CONTROLLER = controller_preset("practical_pd_ddob")
JITTER = {"mean_s": 0.08, "spread_s": 0.03, "model": "normal"}
PLANTS = {
    "ideal": PlantSettings(duration_s=6.0),
    "80 ± 30 ms": PlantSettings.model_validate(
        {"duration_s": 6.0, "latency": {"downlink": {"mean_s": 0.08}, "uplink": JITTER}}
    ),
}
KINDS: tuple[type[Message], ...] = (SteeringCommand, LateralError)
ONSET_NS = ATTACK_NS = 2 * NS_PER_S
RUNS = (1, 2, 3, 5, 8, 12)
PAUSES_MS = (0, 20, 50, 100, 140, 200)


def strategies(seed: int, count: int) -> Iterator[list[list[Shot]]]:
    """Draw what is sent behind each true frame, in turn."""
    rng = random.Random(seed)
    for _ in range(count):
        yield [
            [
                Shot(rng.randrange(30 * NS_PER_MS), rng.choice((1, 2, 5, 16, 31, -60, 100)))
                for _ in range(rng.randrange(1, 4))
            ]
            for _ in range(rng.randrange(1, 5))
        ]


def longest_gap_ns(rule: SequenceRule, strays: int) -> int:
    """Return the longest time in which no further frame comes into use."""
    shots: list[list[Shot]] = [[] for _ in range(100)]
    for stray in range(strays):
        shots[20 * stray] = [Shot(100_000, 60)]
    heard = hear(rule, shots, repeats=False, frames=200)
    used_ns = [one.time_ns for one in heard.events[ALONE:] if one.result in CHANGING]
    return max(after - before for before, after in pairwise(used_ns))


def followed(rule: SequenceRule, seed: int, count: int) -> int:
    """Return how many forged frames the best strategy gets followed."""
    rng = random.Random(seed)
    return max(
        followed_after(
            rule, shots, Absence(since, since + rng.randrange(1, 150), rng.randrange(256))
        )
        for shots, since in product(strategies(seed, count), (0, 150))
    )


@cache
def silence_m(network: str) -> float:
    """Return what the worse silence of a message costs."""
    attacks = (Attack(kind, 0.0, ONSET_NS, ATTACK_NS) for kind in KINDS)
    return max(drive(PLANTS[network], CONTROLLER, attack).peak_m for attack in attacks)


def cost_m(network: str, seed: int, count: int) -> float:
    """Return the cost of the worst attack beyond that of silence."""
    attacks = (
        Attack(kind, sign * (0.2 if kind is LateralError else 0.6), ONSET_NS, ATTACK_NS, shots)
        for shots, kind, sign in product(strategies(seed, count), KINDS, (1, -1))
    )
    worst_m = max(drive(PLANTS[network], CONTROLLER, attack).peak_m for attack in attacks)
    return worst_m - silence_m(network)


def holds(strays: int) -> int:
    """Return how often a node holds after a few stray frames, 100 ms apart."""
    shots = [[Shot(100_000, 1)] if step % 10 == 0 else [] for step in range(10 * strays)]
    count = 0
    for kind in KINDS:
        attack = Attack(kind, 0.2, ONSET_NS, ATTACK_NS, shots, repeats=False)
        run = drive(PLANTS["ideal"], CONTROLLER, attack)
        count += int(run.plant["safety"]["holdings"]) + int(run.controller["holds"])
    return count


def main(arguments: Sequence[str] | None = None) -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strategies", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(arguments)
    console = plain_console()
    console.print("  run   forged frames followed   longest gap [ms] after 1, 2, 3, 4 strays")
    for run in RUNS:
        rule = CONTROLLER.counters._replace(resync_run=run)
        most = followed(rule, asked.seed, 60 * asked.strategies)
        gaps = "".join(f"{longest_gap_ns(rule, n) / NS_PER_MS:6.0f}" for n in (1, 2, 3, 4))
        console.print(f"{run:5} {most:20} {'':8} {gaps}")
    console.print(
        "pause [ms]   cost beyond silence [m]: " + ", ".join(PLANTS) + "   holds after 1, 2 strays"
    )
    for pause_ms in PAUSES_MS:
        reception.PAUSE_NS = pause_ms * NS_PER_MS
        costs = "".join(f"{cost_m(one, asked.seed, asked.strategies):10.2f}" for one in PLANTS)
        console.print(f"{pause_ms:6} {'':15} {costs} {'':12} {holds(1):6} {holds(2):4}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
