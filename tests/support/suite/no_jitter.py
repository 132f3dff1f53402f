"""A check without the jitter that the loop tolerates, for tests that assert nothing about it.

It takes three quarters of a check.
"""

import pytest

from steer_by_wire.controller.analysis import jitter


@pytest.fixture
def no_jitter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Analyse no jitter."""
    monkeypatch.setattr(jitter, "MEANS_MS", ())
