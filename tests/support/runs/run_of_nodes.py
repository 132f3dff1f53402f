"""The figures of a study's run as the nodes make them in virtual time."""

from typing import Any

import numpy as np

from steer_by_wire.closed_loop.studies.compiled_figures import COLUMNS
from steer_by_wire.closed_loop.studies.node_runs import run_on_nodes
from steer_by_wire.closed_loop.studies.scenario import Scenarios


def assert_nodes_reproduce(scenarios: Scenarios, row: dict[str, Any]) -> None:
    """Demand every figure of a stored run that came to its end, to the last bit."""
    assert row["ended_by"] == "complete"
    pair, figures = scenarios.pair(row["id"]), np.full(len(COLUMNS), np.nan)
    end = run_on_nodes(pair, scenarios.study.settings.verdict, figures)
    assert str(end) == "complete"
    np.testing.assert_array_equal(figures, [row[name] for name in COLUMNS])
