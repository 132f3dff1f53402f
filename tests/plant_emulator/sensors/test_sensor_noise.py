import itertools
from collections.abc import Iterator

import numpy as np
import pytest

from steer_by_wire.plant_emulator.sensors.sampling import with_noise

NOTHING = (0.0, 0.0, 0.0)


def uniforms() -> Iterator[float]:
    return iter(np.random.default_rng(5).uniform(1e-12, 1.0 - 1e-12, 30_000).tolist())


def test_noise_has_the_deviations_it_was_asked_for() -> None:
    stream = uniforms()
    deviation = (0.02, 0.003, 0.1)
    samples = np.array([with_noise(NOTHING, deviation, stream) for _ in range(10_000)])
    assert samples.std(axis=0) == pytest.approx(deviation, rel=0.03)
    assert samples.mean(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=0.003)
    assert np.corrcoef(samples.T)[np.triu_indices(3, 1)] == pytest.approx([0.0] * 3, abs=0.04)


def test_switching_one_noise_off_leaves_the_others_as_they_were() -> None:
    all_on, one_off = uniforms(), uniforms()
    for _ in range(100):
        noisy = with_noise(NOTHING, (0.02, 0.003, 0.1), all_on)
        rest = with_noise(NOTHING, (0.0, 0.003, 0.1), one_off)
        assert rest == (0.0, *noisy[1:])


def test_a_sample_takes_three_uniforms_even_when_nothing_is_noisy() -> None:
    stream = itertools.repeat(0.5, 4)
    with_noise(NOTHING, NOTHING, stream)
    assert list(stream) == [0.5]
