"""The lag of the steering and the virtual mass as measured: which of many gains a law takes.

There are gains for the settings' lag and each of ``LAGS_S`` with each of ``MASS_RATIOS``. Two
filters choose among them, each for itself: ``controller.prediction.lag_filter`` by the wheel angle
against the commands, ``controller.prediction.mass_filter`` by the yaw rate against the wheel
angle. Neither uses the result of the other. What is not measured keeps its value of the settings.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ..history.echo_delay import LoopDelayParams
from ..law_interface import History, LoopDelay
from .lag_filter import AS_SET, LAGS_S, NO_LAG, LagState, lag_to
from .mass_filter import AS_SET as MASS_AS_SET
from .mass_filter import (
    MASS_RATIOS,
    NO_ENDS,
    MassEnds,
    MassState,
    ends_between,
    mass_as_set,
    mass_to,
)
from .vehicle_kalman_filter import VehicleGains, row_of

MASSES = len(MASS_RATIOS)
SET = AS_SET * MASSES + MASS_AS_SET
"""Place of the gains with the lag and the mass of the settings."""


class MeasuredParams(NamedTuple):
    """What is measured, and the gains to choose from.

    ``gains``       by lag, and then by mass
    ``lag_choice``  until a lag is known
    ``light``, ``heavy``  the gains with the settings' lag and the extreme masses
    ``mass_ends``   between two masses, if the mass is measured
    """

    gains: Sequence[VehicleGains]
    measures_lag: bool
    measures_mass: bool
    lag_choice: int
    light: VehicleGains
    heavy: VehicleGains
    mass_ends: MassEnds


class MeasuredState(NamedTuple):
    """Both filters."""

    lag: LagState
    mass: MassState


def measured_to(
    p: MeasuredParams,
    of: LoopDelayParams,
    x: MeasuredState,
    loop_delay: LoopDelay,
    history: History,
    yaw_rate_rad_s: float,
) -> MeasuredState:
    """Return both filters at the newest echo."""
    if not p.measures_lag and not p.measures_mass:
        return x
    lag, mass = x.lag, x.mass
    if p.measures_lag:
        lag = lag_to(of, lag, loop_delay, history)
    if p.measures_mass:
        mass = mass_to(p.light, p.heavy, p.mass_ends, mass, loop_delay, history, yaw_rate_rad_s)
    return MeasuredState(lag, mass)


def measured_gains(p: MeasuredParams, x: MeasuredState) -> VehicleGains:
    """Return the gains of the lag and the mass that the filters have chosen."""
    return row_of(p.gains, x.lag.choice * MASSES + x.mass.choice)


def nothing_measured(p: MeasuredParams) -> MeasuredState:
    """Return the state before the first sample: lag and mass of the settings."""
    return MeasuredState(NO_LAG._replace(choice=p.lag_choice), mass_as_set(p.mass_ends))


def choices_of(
    lag_s: float, *, measures_lag: bool, measures_mass: bool
) -> list[tuple[float, float]]:
    """Return lag [s] and mass ratio of each place among the gains; unused places are as set."""
    lags_s = [lag_s, *(LAGS_S if measures_lag else [lag_s] * len(LAGS_S))]
    ratios = MASS_RATIOS if measures_mass else [1.0] * MASSES
    return [(lag, ratio) for lag in lags_s for ratio in ratios]


def measured_params(
    gains: Sequence[VehicleGains], lag_s: float, *, measures_lag: bool, measures_mass: bool
) -> MeasuredParams:
    """Return the parameters for gains in the order of ``choices_of``."""
    # A measured lag that is the set one changes nothing.
    is_known = measures_lag and lag_s in LAGS_S
    return MeasuredParams(
        gains,
        measures_lag,
        measures_mass,
        1 + LAGS_S.index(lag_s) if is_known else AS_SET,
        gains[0],
        gains[MASSES - 1],
        ends_between(tuple(gains[:MASSES])) if measures_mass else NO_ENDS,
    )
