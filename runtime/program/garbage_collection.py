"""No garbage collection while a node runs: a collection takes milliseconds."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Collect now, and not again until the end of the block.

    Reference counting still frees everything outside of reference cycles.
    """
    gc.collect()
    gc.freeze()
    try:
        with no_collections():
            yield
    finally:
        gc.unfreeze()


@contextmanager
def no_collections() -> Iterator[None]:
    """Collect no garbage until the end of the block; nodes make no reference cycles."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
