"""Loss of frames: independent (Bernoulli) or in bursts (Gilbert), one uniform per frame.

A two-state Markov chain steps once per frame (Gilbert 1960):

    good ⇄ burst      P(good → burst) = p,   P(burst → good) = r = 1 / burst_frames
    lost with probability k in the good state, h in a burst

A burst loses every frame (k = 0, h = 1). Instead of p the settings give what a user can measure,
the long-run share of lost frames, p / (p + r). Bernoulli is the case k = h = loss, where the state
makes no difference.
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


def gilbert(loss: float, burst_frames: float) -> LossParams:
    """Return the chain with the long-run share ``loss`` of lost frames.

    ``burst_frames`` is the mean length of a burst in frames (at least 1). If bursts would have to
    follow each other without a good frame, they grow until losses are no longer correlated.
    """
    if loss in (0.0, 1.0):
        return bernoulli(loss)
    leave = min(1.0 / burst_frames, 1.0 - loss)
    return LossParams(leave * loss / (1.0 - loss), 1.0 - leave, 0.0, 1.0)


def loss_step(p: LossParams, in_burst: bool, u: float) -> tuple[bool, bool]:
    """Advance the chain by one frame; returns (now in a burst, frame lost).

    One uniform serves both decisions: given the first, its remainder is uniform again.
    """
    burst = p.burst_after_burst if in_burst else p.burst_after_good
    if u < burst:
        return True, u < burst * p.loss_in_burst
    return False, u - burst < (1.0 - burst) * p.loss_in_good
