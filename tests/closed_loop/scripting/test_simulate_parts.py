"""Parts of one's own as objects, as a notebook has them: named by their place, never stale."""

import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from steer_by_wire import SettingsError, VehicleModel, simulate
from steer_by_wire.controller.laws.pd import LAW

CELL = """
from typing import NamedTuple
from steer_by_wire import Law, LawOutput, PathModel, path_of_curvature

class Gain(NamedTuple):
    rad_m: float

LAW = Law(
    lambda p, x, observed: (x, LawOutput(-p.rad_m * observed.lateral_error_m, 0.0, 0.0, 0.0)),
    lambda p, error_m: 0.0,
    lambda settings: Gain(SCALE),
)
ROAD = PathModel(lambda own: path_of_curvature([(0.5, 0.0), (2.0, 0.02 * SCALE), (9.0, 0.0)]))
"""


def overrides_with(part: str, cell: ModuleType) -> dict[str, Any]:
    of_part: dict[str, dict[str, Any]] = {
        "LAW": {"controller.law": vars(cell)["LAW"]},
        "ROAD": {"plant.path": {"kind": "own", "model": vars(cell)["ROAD"]}},
    }
    return of_part[part]


@pytest.mark.parametrize("engine", ["virtual", "compiled"])
@pytest.mark.parametrize("part", ["LAW", "ROAD"])
def test_a_part_that_a_cell_defines_anew_acts_at_once(
    part: str, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", cell)

    def errors_m(scale: float) -> Any:
        exec(CELL.replace("SCALE", str(scale)), vars(cell))  # noqa: S102
        run = simulate(
            controller="practical_pd",
            duration_s=2.0,
            overrides=overrides_with(part, cell),
            engine=engine,
        )
        assert run.outcome == "complete"
        return run.plant.lateral_error_m

    first, second, again = errors_m(1.0), errors_m(2.0), errors_m(1.0)
    assert not np.array_equal(first, second)
    assert np.array_equal(first, again)


def test_the_record_of_a_run_names_the_place() -> None:
    run = simulate(controller="practical_pd", law=LAW, duration_s=0.5)
    assert run.controller_settings.law == "steer_by_wire.controller.laws.pd:LAW"


def test_a_part_without_a_name_is_refused_in_one_line() -> None:
    unnamed = {"plant.vehicle": {"model": VehicleModel(lambda *_: ())}}
    with pytest.raises(SettingsError, match="VehicleModel has no name at the top of a module"):
        simulate(overrides=unnamed)


def test_the_network_is_given_by_what_one_thinks_of() -> None:
    run = simulate(duration_s=3.0, latency_s=0.08, jitter_s=0.02, loss=0.1)
    downlink = run.plant_settings.latency.downlink
    assert (downlink.mean_s, downlink.spread_s, downlink.loss) == (0.08, 0.02, 0.1)
    assert downlink.model == "gamma"
    constant = simulate(duration_s=0.5, latency_s=0.08, jitter_s=0.0)
    assert constant.plant_settings.latency.downlink.model == "constant"


@pytest.mark.parametrize("engine", ["virtual", "compiled"])
def test_latencies_given_one_by_one_are_those_of_the_commands(engine: Any) -> None:
    latencies_s = np.linspace(0.03, 0.001, 30)  # none overtakes another
    run = simulate(duration_s=2.0, latencies=latencies_s, engine=engine)
    met_s = run.plant.downlink_latency_s
    assert set(np.round(met_s[np.isfinite(met_s)], 9)) <= set(np.round(latencies_s, 9))
    assert len(set(np.round(met_s, 6))) > 10
    assert run.plant_settings.latency.downlink.latencies_s == tuple(latencies_s)


def test_latencies_given_one_by_one_exclude_a_schedule() -> None:
    schedule = {"plant.latency.downlink.schedule": [{"time_s": 0.0, "mean_s": 0.1}]}
    with pytest.raises(SettingsError, match="schedule and latencies_s exclude each other"):
        simulate(latencies=[0.1], overrides=schedule)
    with pytest.raises(SettingsError, match=r"latencies_s\[0\] = -0\.1 should be greater"):
        simulate(latencies=[-0.1])
    with pytest.raises(SettingsError, match=r"latencies_s = 0\.1 should be a valid array"):
        simulate(latencies=0.1)  # type: ignore[arg-type]
