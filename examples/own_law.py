"""A law of your own: PD with an integral that does not wind up
============================================================

Compared with plain PD, in virtual time:

::

    u = C(0 - y) - I,     dI/dt = K_i y + (u - u_sent)/T_t

::

    python examples/own_law.py
    PYTHONPATH=examples steer-by-wire controller --law own_law:LAW --check
"""

from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from pydantic import PositiveFloat

from steer_by_wire import (
    ControllerSettings,
    Law,
    LawInput,
    LawOutput,
    Run,
    Settings,
    law_styles,
    simulate,
)
from steer_by_wire.law_parts import (
    PdParams,
    SectionState,
    design_pd,
    last_command,
    pd_at_rest,
    pd_step,
)


class OwnTable(Settings):  # [own_law] of a settings file; C(s) is that of [pd]
    integral_gain_rad_s_m: PositiveFloat = 0.5  # K_i
    tracking_time_s: PositiveFloat = 0.5  # T_t


class Params(NamedTuple):
    pd: PdParams
    integral_gain_rad_m: float  # over one control period
    tracking: float


class State(NamedTuple):
    pd: SectionState
    integral_rad: float
    wanted_rad: float


def design(settings: ControllerSettings) -> Params:
    own, period_s = settings.table_of(OwnTable), settings.period_s
    pd = design_pd(settings.pd, period_s)
    return Params(pd, own.integral_gain_rad_s_m * period_s, period_s / own.tracking_time_s)


def step(p: Params, x: State, observed: LawInput) -> tuple[State, LawOutput]:
    error_m, not_sent_rad = observed.lateral_error_m, x.wanted_rad - observed.sent_steer_rad
    integral_rad = x.integral_rad + p.integral_gain_rad_m * error_m + p.tracking * not_sent_rad
    x_pd, demand_rad = pd_step(p.pd, x.pd, error_m)
    wanted_rad = demand_rad - integral_rad
    return State(x_pd, integral_rad, wanted_rad), LawOutput(wanted_rad, 0.0, 0.0, error_m)


def at_rest(p: Params, lateral_error_m: float) -> State:
    return State(pd_at_rest(p.pd, lateral_error_m), 0.0, 0.0)


LAW = Law(step, at_rest, design, settings=OwnTable, needs=("pd",), commands_read=last_command)


def main(folder: Path = Path("out/examples")) -> dict[str, Run]:
    network = {
        "controller.followed_point": "preview",  # the own law knows no other point
        "plant.latency.downlink.mean_s": 0.08,
        "plant.disturbance.steps": [{"at_s": 10.0, "steering_offset_rad": 0.02}],
    }
    figure = Figure(figsize=(8.0, 4.0), layout="constrained", dpi=110)
    axes = figure.subplots()
    runs = {}
    laws: dict[str, str | Law] = {"pd": "pd", "with an integral": LAW}
    for style, (label, law) in zip(law_styles(laws), laws.items(), strict=True):
        run = simulate(controller="practical_pd", law=law, overrides=network)
        axes.plot(run.plant.time_s, 1e3 * run.plant.lateral_error_m, label=label, **style)
        runs[label] = run
    axes.set(xlabel="time [s]", ylabel="preview point off the path [mm]")
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_law.png")
    return runs


if __name__ == "__main__":
    main()
