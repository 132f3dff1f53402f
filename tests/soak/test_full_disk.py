"""A full disk, or one that fails once, at drawn uses of each kind; the rest is for the command."""

import pytest

from tests.soak.full_disk import search

SEED = 7


@pytest.mark.parametrize("name", ["run", "can bits", ".log", ".asc"])
def test_a_full_disk_is_one_line_and_loses_nothing_whole(name: str) -> None:
    broken: list[str] = []
    count = search([name], SEED, 0.2 if name == "run" else 0.5, broken.append)
    assert not broken
    assert count > 0
