"""Loss of frames: how many, how long the bursts, and the edges of the settings."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.network.loss import LossParams, bernoulli, gilbert, loss_step

FRAMES = 200_000
probabilities = st.floats(0.0, 1.0)
burst_lengths = st.floats(1.0, 1e6)


def fates(params: LossParams, frames: int = FRAMES) -> tuple[list[bool], list[bool]]:
    """The state of the chain at each frame, and whether the frame is lost."""
    uniform = np.random.Generator(np.random.PCG64(5)).random(frames).tolist()
    in_burst = False
    bursts, lost = [], []
    for u in uniform:
        in_burst, is_lost = loss_step(params, in_burst, u)
        bursts.append(in_burst)
        lost.append(is_lost)
    return bursts, lost


def runs(values: list[bool]) -> list[int]:
    return [len(list(group)) for value, group in groupby(values) if value]


def share_lost(p: LossParams) -> float:
    """The long-run share, from the chain's stationary distribution."""
    leave = 1.0 - p.burst_after_burst
    total = p.burst_after_good + leave
    in_burst = p.burst_after_good / total if total else 0.0
    return (1.0 - in_burst) * p.loss_in_good + in_burst * p.loss_in_burst


@pytest.mark.parametrize("loss", [0.0, 0.01, 0.3, 1.0])
def test_independent_loss_is_as_frequent_as_asked(loss: float) -> None:
    _, lost = fates(bernoulli(loss))
    assert np.mean(lost) == pytest.approx(loss, abs=0.003)


@pytest.mark.parametrize(("loss", "burst_frames"), [(0.02, 5.0), (0.10, 20.0), (0.05, 1.0)])
def test_bursts_lose_the_share_asked_for_and_are_as_long_as_asked(
    loss: float, burst_frames: float
) -> None:
    bursts, lost = fates(gilbert(loss, burst_frames))
    assert lost == bursts
    assert np.mean(lost) == pytest.approx(loss, rel=0.1)
    assert np.mean(runs(bursts)) == pytest.approx(burst_frames, rel=0.1)


def test_a_chain_by_hand() -> None:
    # Half of a hundredth of the frames' worth of bursts of four frames each.
    assert gilbert(0.2, 4.0) == pytest.approx((0.0625, 0.75, 0.0, 1.0))


@given(probabilities, burst_lengths)
def test_every_loss_has_a_chain_with_that_long_run_share(loss: float, burst_frames: float) -> None:
    params = gilbert(loss, burst_frames)
    assert all(0.0 <= probability <= 1.0 for probability in params)
    assert share_lost(params) == pytest.approx(loss, rel=1e-6, abs=1e-9)


def test_bursts_that_would_have_to_touch_grow() -> None:
    bursts, lost = fates(gilbert(0.9, 2.0))
    assert np.mean(lost) == pytest.approx(0.9, abs=0.005)
    assert np.mean(runs(bursts)) == pytest.approx(10.0, rel=0.05)  # 1 / (1 − 0.9)


@given(st.floats(2.0**-54, 1.0 - 2.0**-53), st.booleans())
def test_no_loss_loses_nothing_and_full_loss_everything(u: float, in_burst: bool) -> None:
    assert not loss_step(bernoulli(0.0), in_burst, u)[1]
    assert loss_step(bernoulli(1.0), in_burst, u)[1]


@given(st.floats(2.0**-54, 1.0 - 2.0**-53), probabilities, probabilities, st.booleans())
def test_a_frame_lost_at_a_low_rate_is_lost_at_a_higher_one(
    u: float, one: float, other: float, in_burst: bool
) -> None:
    _, lost_at_low = loss_step(bernoulli(min(one, other)), in_burst, u)
    _, lost_at_high = loss_step(bernoulli(max(one, other)), in_burst, u)
    assert lost_at_high or not lost_at_low
