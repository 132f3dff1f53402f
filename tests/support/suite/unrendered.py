"""Pictures that are composed but not rendered, for tests that assert nothing about them.

Rendering one takes up to half a second. The tests of each program's pictures do without this.
"""

from typing import Any

import pytest
from matplotlib.figure import Figure


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every figure saved as a file of a few bytes."""

    def save(_figure: Figure, file: Any, **_options: object) -> None:
        if hasattr(file, "write"):
            file.write(b"not rendered")
        else:
            with open(file, "wb") as opened:
                opened.write(b"not rendered")

    monkeypatch.setattr(Figure, "savefig", save)
