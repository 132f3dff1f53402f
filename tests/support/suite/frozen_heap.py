"""Keeps all that is imported and collected out of garbage collections, and has fewer of these.

There are a million objects, and a program that a test runs in this process collects first. At its
end it unfreezes all that was frozen, also what was before it.
"""

import gc
from collections.abc import Generator, Iterator

import pytest

_THRESHOLDS = (20_000, 10, 100)
"""Objects, and collections of the younger generation, before one: 700, 10 and 10 take four times
as long."""


class FrozenHeap:
    """A plugin of pytest."""

    def __init__(self) -> None:
        self._unfreeze = gc.unfreeze
        self._is_frozen = False

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        gc.disable()  # what is imported and collected stays
        try:
            return (yield)
        finally:
            gc.set_threshold(*_THRESHOLDS)
            gc.enable()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self) -> None:
        gc.collect(1)
        gc.unfreeze = self._on_unfreeze

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self) -> None:
        if not self._is_frozen:
            gc.freeze()
            self._is_frozen = True

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_sessionfinish(self) -> Iterator[None]:
        gc.unfreeze = self._unfreeze
        gc.unfreeze()
        yield
        gc.collect()  # finds what was not closed
        gc.freeze()  # pytest collects several times more, and the interpreter at its end

    def _on_unfreeze(self) -> None:
        self._unfreeze()
        self._is_frozen = False
