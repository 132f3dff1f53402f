"""Combinations of values for ``parametrize``: as many as show each value once, or all of them."""

from collections.abc import Sequence
from itertools import product
from typing import Any

ALL: list[bool] = []
"""Holds something if pytest tries all combinations: ``--hypothesis-profile=explore``."""


def combined(*axes: Sequence[Any]) -> list[tuple[Any, ...]]:
    """Return tuples with one value of each axis."""
    if ALL:
        return list(product(*axes))
    rows = max(map(len, axes))
    # Shifted at each repetition, so that a value meets more than every n-th of a longer axis.
    return [
        tuple(axis[(row + row // len(axis)) % len(axis)] for axis in axes) for row in range(rows)
    ]
