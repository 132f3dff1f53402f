"""A law of your own, PD with an integral that does not wind up, in virtual time beside plain PD.

u = C(0 - y) - I,     dI/dt = K_i y + (u - u_sent)/T_t

python examples/own_law.py
PYTHONPATH=examples steering-controller --law own_law:LAW --check
"""

from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from pydantic import PositiveFloat

from steer_by_wire.controller.design import design_pd
from steer_by_wire.controller.law_settings import LawSettings
from steer_by_wire.controller.laws import Law, LawInput, LawOutput, last_command
from steer_by_wire.controller.pd import PdParams, pd_at_rest, pd_step
from steer_by_wire.controller.sections import SectionState
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.pair.virtual import run_virtual_pair
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings import Settings, load_settings, read_preset


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


def design(settings: LawSettings) -> Params:
    own, period_s = settings.table_of(OwnTable), settings.period_s
    pd = design_pd(settings.pd, period_s)
    return Params(pd, own.integral_gain_rad_s_m * period_s, period_s / own.tracking_time_s)


def step(p: Params, x: State, seen: LawInput) -> tuple[State, LawOutput]:
    error_m, not_sent_rad = seen.lateral_error_m, x.wanted_rad - seen.sent_steer_rad
    integral_rad = x.integral_rad + p.integral_gain_rad_m * error_m + p.tracking * not_sent_rad
    x_pd, demand_rad = pd_step(p.pd, x.pd, error_m)
    wanted_rad = demand_rad - integral_rad
    return State(x_pd, integral_rad, wanted_rad), LawOutput(wanted_rad, 0.0, 0.0, error_m)


def at_rest(p: Params, lateral_error_m: float) -> State:
    return State(pd_at_rest(p.pd, lateral_error_m), 0.0, 0.0)


LAW = Law(step, at_rest, design, settings=OwnTable, commands_read=last_command)


def main(folder: Path = Path("out/examples")) -> None:
    rig = read_preset("steer_by_wire.plant_emulator.presets", "paper_nominal")
    push = "disturbance.steps=[{at_s=10, steering_offset_rad=0.02}]"
    plant = load_settings(PlantSettings, rig, overrides=["latency.downlink.mean_s=0.08", push])
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.subplots()
    for law in ("pd", "own_law:LAW"):
        preset = read_preset("steer_by_wire.controller.presets", "practical_pd")
        controller = load_settings(ControllerSettings, preset, overrides=[f"law={law}"])
        trace = run_virtual_pair(plant, controller).trace
        axes.plot(trace.time_s, 1e3 * trace.lateral_error_m, label=law)
    axes.set(xlabel="time [s]", ylabel="lateral error [mm]")
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_law.png", dpi=110)


if __name__ == "__main__":
    main()
