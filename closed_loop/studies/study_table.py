"""Runs a whole study from Python and returns its table; for long ones there is stress_latency."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .scenario import Scenarios


def run_study(file: str | Path) -> Mapping[str, NDArray[Any]]:
    """Compute every run of a study file on one thread; returns columns of shape (runs,) by name.

    ``controller``, ``replicate``, ``verdict``, the factors by their names, and the figures of
    ``results.parquet`` of ``stress_latency``; in the same order and the same to the last bit.
    Nothing is stored. Raises SettingsError.
    """
    from .compute import Computer
    from .figures import COLUMNS, Figures
    from .scenario import Scenarios
    from .study import load_study
    from .verdict import verdicts

    scenarios = Scenarios(load_study(Path(file)))
    scenarios.check()
    runs = range(scenarios.study.runs)
    done = Computer(scenarios).compute(runs, lambda: False)
    judged = verdicts(
        scenarios.study.settings.verdict, done.ends, done.figures[:, : len(Figures._fields)]
    )
    return {
        **_factors(scenarios),
        "verdict": np.array([str(verdict) for verdict in judged]),
        **dict(zip(COLUMNS, done.figures.T.copy(), strict=True)),
    }


def _factors(scenarios: "Scenarios") -> dict[str, NDArray[Any]]:
    """Return the columns in which the runs differ."""
    names = scenarios.controllers
    cases = [scenarios.case(run // len(names)) for run in range(scenarios.study.runs)]
    factors = [factor.name for factor in scenarios.study.design.factors]
    return {
        "controller": np.tile(np.array(names), scenarios.study.cases),
        "replicate": np.array([case.replicate for case in cases]),
        **{
            name: np.array([case.labels[place] for case in cases])
            for place, name in enumerate(factors)
        },
    }
