"""Cases for ``parametrize``: a sample of them, or all: ``--hypothesis-profile=explore``."""

from collections.abc import Sequence
from itertools import product
from typing import Any

ALL: list[bool] = []
"""Holds something if pytest tries all of them."""


def sampled(sample: Any, whole: Any) -> Any:
    """Return the sample, unless all is tried."""
    return whole if ALL else sample


def combined(*axes: Sequence[Any]) -> list[tuple[Any, ...]]:
    """Return tuples with one value of each axis: as many as show each value once, or all."""
    if ALL:
        return list(product(*axes))
    rows = max(map(len, axes))
    # Shifted at each repetition, so that a value meets more than every n-th of a longer axis.
    return [
        tuple(axis[(row + row // len(axis)) % len(axis)] for axis in axes) for row in range(rows)
    ]
