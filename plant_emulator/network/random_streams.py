"""Seeded random streams: one per purpose, so that switching one on does not shift another.

Every stream depends on the run's seed and its purpose alone. Two runs with the same seed
meet the same jitter and the same noise, whatever law closes the loop.
"""

from collections.abc import Iterator
from enum import IntEnum
from itertools import chain, repeat

import numpy as np
from numpy.typing import NDArray

BLOCK = 1024
"""Uniforms drawn at once: numpy costs microseconds per call and nanoseconds per number."""

SMALLEST = 2.0**-54
"""Replaces an exact 0, whose quantile is infinite for unbounded distributions."""


class Stream(IntEnum):
    """Purpose of a stream. Its values are part of the meaning of a seed: never renumber them."""

    DOWNLINK = 0
    UPLINK = 2
    SENSOR_NOISE = 4
    FAULTS = 5


def uniforms(
    seed: int, stream: Stream, member: int | None = None, first: int = 0
) -> Iterator[float]:
    """Return the endless stream of uniforms in (0, 1) of one purpose, or of one of its members.

    ``first``  how many are left out at its start, which takes no time
    """
    source = _source(seed, stream, *([] if member is None else [member])).advance(first)
    generator = np.random.Generator(source)
    return chain.from_iterable(
        np.maximum(generator.random(BLOCK), SMALLEST).tolist() for _ in repeat(None)
    )


def first_uniforms(seed: int, stream: Stream, count: int) -> NDArray[np.float64]:
    """Return the first ``count`` numbers of a purpose's stream, shape (count,)."""
    generator = np.random.Generator(_source(seed, stream))
    return np.maximum(generator.random(count), SMALLEST)


def _source(seed: int, stream: Stream, *member: int) -> np.random.PCG64:
    # By name, because numpy may change that of `default_rng`.
    return np.random.PCG64(np.random.SeedSequence([seed, stream, *member]))
