"""Seeded random streams: what a seed means must not change."""

from itertools import islice

import numpy as np
import pytest

from steer_by_wire.plant_emulator.network.random_streams import BLOCK, SMALLEST, Stream, uniforms


def drawn(seed: int, channel: Stream, count: int = 3 * BLOCK) -> list[float]:
    return list(islice(uniforms(seed, channel), count))


def test_a_seed_and_a_channel_are_a_stream() -> None:
    assert drawn(1, Stream.UPLINK) == drawn(1, Stream.UPLINK)


def test_every_seed_and_channel_has_a_stream_of_its_own() -> None:
    firsts = [drawn(seed, channel, 1)[0] for seed in (0, 1, 2**63 - 1) for channel in Stream]
    assert len(set(firsts)) == len(firsts)


def test_the_blocks_are_one_stream() -> None:
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([9, 2])))
    assert drawn(9, Stream.UPLINK) == generator.random(3 * BLOCK).tolist()


@pytest.mark.parametrize(
    ("channel", "first"),
    [
        (Stream.DOWNLINK, 0.833986389852156),
        (Stream.UPLINK, 0.04832031021522609),
        (Stream.SENSOR_NOISE, 0.5893642012390503),
    ],
)
def test_a_seed_means_the_same_numbers_for_ever(channel: Stream, first: float) -> None:
    assert drawn(1086, channel, 1) == [first]


def test_no_number_is_zero_or_one() -> None:
    numbers = drawn(3, Stream.DOWNLINK, 100_000)
    assert 0.0 < SMALLEST <= min(numbers) < max(numbers) < 1.0
