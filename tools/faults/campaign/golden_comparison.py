"""Faults on messages that no node receives: the run has to be the golden one, bit for bit.

Such messages are for monitoring alone. No node in the loop may react to a fault on them: every
sample of the plant and every command must be the same as in the run of the same seed without a
fault.
"""

from functools import lru_cache
from hashlib import sha256

import numpy as np

from .campaign_runs import Scenario, golden_case
from .node_watch import COMMAND_IDS
from .watched_pair import Pair, make_pair, run_pair

_GOLDEN_KEPT = 32
UNHINDERED_BIT_S = 1_000_000_000
"""A frame takes less than a microsecond."""


def is_as_golden(scenario: Scenario, pair: Pair) -> bool:
    """Whether a run that is over moved as the run without a fault does.

    A frame on the wire delays the others; at high rates that is all that a message for monitoring
    may do to them. Such runs are the same on a bus where no frame has to wait.
    """
    golden = scenario._replace(case=golden_case())
    return _digest(pair) == _digest_of(golden) or (
        _digest_of(_unhindered(scenario)) == _digest_of(_unhindered(golden))
    )


def _unhindered(scenario: Scenario) -> Scenario:
    spec = scenario.spec.model_copy(update={"bitrate_bit_s": UNHINDERED_BIT_S})
    return scenario._replace(spec=spec)


@lru_cache(_GOLDEN_KEPT)
def _digest_of(scenario: Scenario) -> str:
    pair = make_pair(scenario)
    run_pair(scenario, pair)
    return _digest(pair)


def _digest(pair: Pair) -> str:
    digest = sha256(np.array(pair.plant_node.samples, dtype=np.float64).tobytes())
    commands = sorted(frame.data for frame in pair.controller.sent if frame.can_id in COMMAND_IDS)
    digest.update(b"".join(commands))
    return digest.hexdigest()
