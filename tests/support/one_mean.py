"""A check with the jitter of one mean latency, for tests that assert nothing about the other.

That of 160 ms takes longer than the rest of a check.
"""

import pytest

from steer_by_wire.controller.analysis import check_in_json


@pytest.fixture
def one_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    """Analyse jitter at a mean of 80 ms only."""
    monkeypatch.setattr(check_in_json, "JITTER_MEANS_MS", (80,))
