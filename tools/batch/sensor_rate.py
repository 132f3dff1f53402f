"""When the controller takes the sensors' period for wrong, laid down before a compiled run."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.sensor_rate import NO_RATE, RateState, rate_step
from tools.batch.compilation import compiled
from tools.batch.network import IntArray
from tools.batch.plan import Arrivals


def wrong_at(period_ns: int, errors: Arrivals, newest: IntArray) -> NDArray[np.bool_]:
    """Return whether the period counts as wrong at each tick.

    ``period_ns``  the setting
    ``errors``     measurements of rising samples
    ``newest``     the index in them of the newest at each tick, -1 for none
    """
    wrong = _run_rates(period_ns, NO_RATE, errors.arrival_ns, errors.sample)
    return np.append(wrong, False)[newest]


@compiled
def _run_rates(period_ns: int, x: RateState, arrival_ns: Any, sample: Any) -> Any:
    """Return whether the period counts as wrong after each measurement."""
    wrong = np.empty(len(sample), dtype=np.bool_)
    for index in range(len(sample)):
        x = rate_step(period_ns, x, sample[index], arrival_ns[index])
        wrong[index] = x.is_wrong
    return wrong
