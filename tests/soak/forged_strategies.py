"""Print what intruders without a key cost beyond silence, behind jitter and at speed.

    python -m tests.soak.forged_strategies [--of "highway_pd, ideal"]

Every strategy of ``tests.system.test_second_senders`` runs for two seconds in virtual time, against
measurements and against commands; silence is the worse one of the two, for as long. A line has the
largest lateral error of the worst strategy. Takes about ten minutes.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import LateralError, Message, SteeringCommand
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.node import NS_PER_S
from tests.support.intruder import Attack, drive
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
    silence_m = max(
        drive(plant, controller, Attack(kind, 0.0, onset_ns, ATTACK_NS)).peak_m for kind in KINDS
    )
    for kind, value in zip(KINDS, values, strict=True):
        costs_m = {
            strategy: drive(
                plant, controller, Attack(kind, value, onset_ns, ATTACK_NS, shots, repeats)
            ).peak_m
            for strategy, (shots, repeats) in STRATEGIES.items()
        }
        worst = max(costs_m, key=lambda strategy: costs_m[strategy])
        beyond_m = costs_m[worst] - silence_m
        found = f"{silence_m:8.2f} {costs_m[worst]:8.2f} {beyond_m:+8.2f}"
        yield f"{name:25} {kind.__name__:16} {found}  {worst}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    known = dict(cases())
    parser = argparse.ArgumentParser(prog="python -m tests.soak.forged_strategies")
    parser.add_argument("--of", nargs="+", choices=known, default=list(known))
    asked = parser.parse_args(arguments)
    console = plain_console()
    console.print(f"{'largest error [m] with':42}  silence   forged   beyond  worst strategy")
    for name in asked.of:
        for line in lines(name, known[name]):
            console.print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
