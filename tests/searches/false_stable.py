"""Ask of drawn loops whether the analysis calls stable what is not.

    python -m tests.searches.false_stable [--loops 1000] [--boxes 30] [--seed 1]

A loop is a law, its rate and the sensors', its gains, a nominal vehicle from 0.6 to 14 t, another
vehicle that is driven, a lag of the wheel and a latency of the measurements. It is asked at a drawn
delay, and half to four per cent beside every limit of stability that the analysis finds. Of a box,
``check`` is asked for its verdict, which is judged at every corner and at 15 delays.

The judge is ``loop_written_apart``; both call stable what decays faster than 0.001 1/s. Prints
counts with the interval of Clopper and Pearson, and each loop on which they disagree; ends with
status 1 if there is one. Takes about ten CPU minutes.
"""

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from steer_by_wire import check
from steer_by_wire.controller.analysis.check_figures import loop_around
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.analysis.stable_delays import RESOLUTION_NS, Loop, stable_delays
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import ControllerSettings
from tests.searches.loop_written_apart import OBSERVERS, Table, decay_1_s

LAWS = ("pd", *OBSERVERS, "pid", "smith")
RATES_HZ = (25.0, 50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0)
SENSORS_MS = (1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 20.0)
SLOWEST_1_S, TIE_1_S = 1e-3, 1e-6
TWO_RATES_SHARE = 0.03
IN_TRANSIT_MAX = {False: 200, True: 25}
"""Control periods of delay that are searched, of one rate and of two: of those each takes 30 ms."""
DRIVEN = ("virtual_mass_kg", "front_cornering_stiffness_n_rad", "speed_m_s")
BOX = ("virtual_mass_kg", "speed_m_s")


class Answer(NamedTuple):
    """Whether the analysis calls a loop stable, the judge's decay [1/s], and the loop in words."""

    is_called_stable: bool
    decay_1_s: float
    loop: str

    @property
    def is_wrong(self) -> bool:
        """Whether the judge disagrees; a tie is none."""
        over_1_s = self.decay_1_s - SLOWEST_1_S
        return abs(over_1_s) > TIE_1_S and self.is_called_stable != (over_1_s > 0.0)


def drawn_vehicle(rng: np.random.Generator) -> Table:
    """Draw anything between a city car and a bus, mostly understeering."""
    mass, speed = np.exp(rng.uniform(np.log([600.0, 0.8]), np.log([14000.0, 25.0]))).tolist()
    front = rear = rng.uniform(0.4, 0.6) * (2.0 + mass / 3500.0)
    load_n = mass * 9.81 / (front + rear)
    return {
        "virtual_mass_kg": mass,
        "yaw_inertia_kg_m2": mass * front * rear * rng.uniform(0.7, 1.3),
        "front_cornering_stiffness_n_rad": rng.uniform(6.0, 14.0) * load_n * rear,
        "rear_cornering_stiffness_n_rad": rng.uniform(9.0, 20.0) * load_n * front,
        "front_axle_distance_m": front,
        "rear_axle_distance_m": rear,
        "preview_distance_m": rng.uniform(1.0, 4.0),
        "speed_m_s": speed,
    }


def drawn_settings(rng: np.random.Generator) -> dict[str, Any]:
    """Draw a law whose gains suit a bandwidth ω of 0.3 to 6 rad/s."""
    rate_hz, sensor_ms = float(rng.choice(RATES_HZ)), float(rng.choice(SENSORS_MS))
    while (1e3 / rate_hz) % sensor_ms and rng.random() > TWO_RATES_SHARE:
        rate_hz, sensor_ms = float(rng.choice(RATES_HZ)), float(rng.choice(SENSORS_MS))
    model, w = drawn_vehicle(rng), math.exp(rng.uniform(math.log(0.3), math.log(6.0)))
    length_m = model["front_axle_distance_m"] + model["rear_axle_distance_m"]
    w_per_gain = w * length_m / model["speed_m_s"] ** 2
    k_p = rng.uniform(0.1, 1.0) * w * w_per_gain
    pd = {
        "proportional_gain_rad_m": k_p,
        "derivative_gain_rad_s_m": rng.uniform(0.0, 1.5) * w_per_gain,
    }
    if rng.random() < 0.8:
        pd["derivative_filter_rad_s"] = rng.uniform(3.0, 60.0)
    pid = {"integral_gain_rad_m_s": k_p * w * rng.uniform(0.03, 0.4)}
    if rng.random() < 0.5:
        pid["heading_gain_rad_rad"] = rng.uniform(0.1, 2.0) * w / model["speed_m_s"]
    chosen, washout = str(rng.choice(LAWS)), {"washout_rad_s": w * rng.uniform(0.1, 1.0)}
    dob, cdob = ({"q_cutoff_rad_s": w * rng.uniform(0.2, 2.0)} for _ in range(2))
    tables: dict[str, Any] = {
        "dob": {**dob, "q_kind": str(rng.choice(["order_2", "type_2"]))},
        "cdob": cdob | washout,
        "smith": {"delay_s": rng.uniform(0.0, 0.4), **washout},
        "pid": pid,
    }
    return {
        "law": chosen,
        "rate_hz": rate_hz,
        "pd": pd,
        "link": {"sensor_period_ms": sensor_ms},
        "nominal_model": {"kind": "vehicle", **model},
        **{name: tables[name] for name in OBSERVERS.get(chosen, (chosen,)) if name in tables},
    }


def asked_of_loop(rng: np.random.Generator) -> Iterator[Answer]:
    """Ask the analysis of one drawn loop at some delays; of one that cannot be set, at none."""
    s = drawn_settings(rng)
    lag_s = 0.0 if rng.random() < 0.95 else rng.uniform(0.02, 0.4)
    uplink_ns = 0 if rng.random() < 0.95 else round(1e6 * rng.uniform(0.1, 40.0))
    driven = {key: value for key, value in s["nominal_model"].items() if key != "kind"}
    for key in DRIVEN:
        driven[key] *= float(rng.choice([1.0, rng.uniform(0.7, 1.4)]))
    tick_ns, vehicle = round(1e9 / s["rate_hz"]), NominalVehicle(**driven)
    is_single = not (lag_s or uplink_ns or tick_ns % round(1e6 * s["link"]["sensor_period_ms"]))
    limit_ns = min(600_000_000, IN_TRANSIT_MAX[not is_single] * tick_ns)
    try:
        settings = ControllerSettings.model_validate(s)
        loop: Loop = loop_around(settings, vehicle, {})
        if lag_s or uplink_ns:
            model = LoopModel(vehicle, lag_s, uplink_ns)
            loop = PeriodicLoop(design_law(settings), settings.loop_delay, model)
        stable = stable_delays(loop, limit_ns)
    except ValueError:
        return
    ends = sorted({end for each in stable for end in each} - {0, limit_ns})
    beside = [end * (1.0 + side * rng.uniform(0.005, 0.04)) for end in ends for side in (-1, 1)]
    drawn = {round(each) for each in (*beside, rng.uniform(0.0, limit_ns)) if each < limit_ns}
    drawn -= {each for each in drawn for end in ends if abs(each - end) < RESOLUTION_NS}
    for delay_ns in sorted(drawn):
        is_stable = any(first <= delay_ns <= last for first, last in stable)
        words = json.dumps([s, driven, delay_ns, lag_s, uplink_ns])
        yield Answer(is_stable, decay_1_s(s, driven, delay_ns, lag_s, uplink_ns), words)


def asked_of_box(rng: np.random.Generator) -> Iterator[Answer]:
    """Ask ``check`` for its verdict on a box of vehicles and delays."""
    s = drawn_settings(rng)
    model, delay_ms = s["nominal_model"], rng.uniform(10.0, 30e3 / s["rate_hz"])
    box = {k: [model[k] * rng.uniform(0.75, 1.0), model[k] * rng.uniform(1.0, 1.3)] for k in BOX}
    s["validity"] = {"delay_ms_max": delay_ms, **box}
    try:
        found = check(ControllerSettings.model_validate(s))
    except ValueError:
        return
    if found.verdict == "not analysed":
        return
    corners = [model, *(model | dict(zip(BOX, at, strict=True)) for at in product(*box.values()))]
    delays_ns = np.linspace(0.0, 1e6 * delay_ms, 15).astype(int).tolist()
    decays_1_s = [decay_1_s(s, corner, delay_ns) for corner in corners for delay_ns in delays_ns]
    yield Answer(found.verdict == "stable", min(decays_1_s), json.dumps(s))


def counted(name: str, answers: Sequence[Answer]) -> Iterator[str]:
    """Yield what the two said, and each loop on which they disagree."""
    for is_stable, what in ((True, "false stable"), (False, "false unstable")):
        said = [one for one in answers if one.is_called_stable is is_stable]
        if said:
            wrong = [one for one in said if one.is_wrong]
            low, high = binomtest(len(wrong), len(said)).proportion_ci(method="exact")
            yield f"{name}: {what} {len(wrong)} of {len(said)} ({low:.2%} to {high:.2%})"
            yield from (f"  {one.decay_1_s:.6f} 1/s: {one.loop}" for one in wrong)


def searched(
    name: str, ask: Callable[[np.random.Generator], Iterator[Answer]], key: list[int], wanted: int
) -> list[Answer]:
    """Return the answers of so many drawn loops."""
    answers, number, asked = list[Answer](), 0, 0
    while asked < wanted:
        more = list(ask(np.random.default_rng([*key, number])))
        answers, number, asked = answers + more, number + 1, asked + bool(more)
        if more and asked % 50 == 0:
            sys.stderr.write(f"{asked} {name}\n")
    return answers


def main() -> int:
    """Draw and ask; returns 1 if the two disagree."""
    parser = argparse.ArgumentParser(prog="python -m tests.searches.false_stable")
    for name, usual in (("--loops", 1000), ("--boxes", 30), ("--seed", 1)):
        parser.add_argument(name, type=int, default=usual)
    options = parser.parse_args()
    is_wrong = False
    for kind, (name, ask, wanted) in enumerate(
        (("loops", asked_of_loop, options.loops), ("boxes", asked_of_box, options.boxes))
    ):
        answers = searched(name, ask, [40, 7, kind, options.seed], wanted)
        sys.stdout.write("".join(f"{line}\n" for line in counted(name, answers)))
        sys.stdout.flush()
        is_wrong |= any(one.is_wrong for one in answers)
    return int(is_wrong)


if __name__ == "__main__":
    sys.exit(main())
