"""A check without the jitter that the loop tolerates, for tests that assert nothing about it.

It takes three quarters of a check.
"""

import pytest

from steer_by_wire.controller.analysis import check_in_json


@pytest.fixture
def no_jitter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Analyse no jitter."""
    monkeypatch.setattr(check_in_json, "JITTER_MEANS_MS", ())
