"""Loss of frames: independent (Bernoulli) or in bursts (Gilbert–Elliott), one uniform per frame.

A two-state Markov chain steps once per frame (Gilbert 1960, Elliott 1963):

    good ⇄ burst      P(good → burst) = p,   P(burst → good) = r = 1 / burst_frames
    lost with probability k in the good state, h in a burst

Instead of p the settings give what a user can measure, the long-run share of lost frames:

    loss = (1 − π) k + π h,      π = p / (p + r), the share of frames in a burst

Bernoulli is the case k = h = loss, where the state makes no difference.
"""

from typing import NamedTuple


class LossParams(NamedTuple):
    """The chain: probability of a burst at the next frame and of loss now, each by state."""

    burst_after_good: float
    burst_after_burst: float
    loss_in_good: float
    loss_in_burst: float


def bernoulli(loss: float) -> LossParams:
    """Return the chain that loses each frame with probability ``loss``, independently."""
    return LossParams(0.0, 0.0, loss, loss)


def gilbert_elliott(
    loss: float, burst_frames: float, loss_in_good: float, loss_in_burst: float
) -> LossParams:
    """Return the chain with the long-run share ``loss`` of lost frames.

    ``burst_frames`` is the mean length of a burst in frames (at least 1). Because ``loss`` may
    change at run time, every value from 0 to 1 has a chain. Outside [loss_in_good, loss_in_burst]
    the nearer of the two is adapted. If bursts would have to follow each other without a good
    frame, they grow until losses are no longer correlated.
    """
    k = min(loss_in_good, loss)
    h = max(loss_in_burst, loss)
    if loss == k:
        return bernoulli(loss)  # no bursts; also where k = h leaves π undefined
    share_in_burst = (loss - k) / (h - k)
    if share_in_burst >= 1.0:
        return bernoulli(loss)
    leave = min(1.0 / burst_frames, 1.0 - share_in_burst)
    enter = leave * share_in_burst / (1.0 - share_in_burst)
    return LossParams(enter, 1.0 - leave, k, h)


def loss_step(p: LossParams, in_burst: bool, u: float) -> tuple[bool, bool]:
    """Advance the chain by one frame; returns (now in a burst, frame lost).

    One uniform serves both decisions: given the first, its remainder is uniform again.
    """
    burst = p.burst_after_burst if in_burst else p.burst_after_good
    if u < burst:
        return True, u < burst * p.loss_in_burst
    return False, u - burst < (1.0 - burst) * p.loss_in_good
