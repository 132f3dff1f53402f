"""Peak sensitivity and noise gain of the sampled loop, for many plants at once.

With L = -P K, the loop cut at the command (P K is a sum over both where the law reads the heading
error too):

    law                K(z) = C (zI - A)⁻¹ B + D                      from lateral error to steer
    plant              P(z) = C (zI - A)⁻¹ (b_new + b_old z⁻¹) z⁻ⁿ    from steer to lateral error
    peak sensitivity   max over ω of |1/(1 + L)| on the unit circle, the inverse of the smallest
                       distance of L from -1
    noise gain         standard deviation of the steer [rad] for white noise of 1 m standard
                       deviation on every measurement:  √(1/2π ∫ |K/(1 + L)|² dθ); on the heading
                       error HEADING_NOISE_1_M of that

The matrices are those of ``controller.analysis.linear_system``.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...controller.analysis.linear_system import (
    held_plant,
    law_system,
    output_rows,
    plant_response,
    triangular,
)
from ...controller.analysis.loop_signals import HEADING_NOISE_1_M
from ...controller.filters.transfer_function import Factor, TransferFunction
from ...controller.laws.law_from_settings import LawDesign
from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_S


def plant_responses(
    models: Sequence[TransferFunction], delays_ns: Sequence[int], period_ns: int, z: ComplexArray
) -> ComplexArray:
    """Return the held plants' responses at each of ``z``, shape (2, corners, delays, Z).

    The first output is the lateral error, the second the heading error.
    """
    responses = []
    for model in models:
        plants = [held_plant(model, period_ns, each, 2) for each in delays_ns]
        rows = output_rows(plants[0], z)
        responses.append(np.stack([plant_response(plant, rows, z) for plant in plants], axis=1))
    return np.stack(responses, axis=1)


def behind_lag(model: TransferFunction, lag_s: float) -> TransferFunction:
    """Return the model behind a steering actuator 1/(lag s + 1); lag ≥ 0 [s]."""
    if lag_s == 0.0:
        return model
    one = Factor(0.0, 0.0, 1.0)
    return model.times(TransferFunction(0, (one,), (Factor(0.0, lag_s, 1.0),)))


_OMEGA_RAD_S_MIN = 0.02
"""The ω of a grid are evenly spread below this, and by a constant factor above it."""


class CircleGrid(NamedTuple):
    """Plants on the upper half of |z| = 1; ``plants`` of shape (2, corners, delays, Z)."""

    angle_rad: FloatArray  # ωT, shape (Z,)
    z: ComplexArray
    plants: ComplexArray


class LoopFigures(NamedTuple):
    """The worst of all vehicles and delays; infinite where one is found to be not stable."""

    peak_sensitivity: float
    noise_gain_rad_m: float


def circle_grid(
    models: Sequence[TransferFunction], delays_ns: Sequence[int], period_ns: int, points: int
) -> CircleGrid:
    """Return the grid, without z = 1."""
    scale = _OMEGA_RAD_S_MIN * period_ns / NS_PER_S
    angle_rad = scale * np.sinh(np.linspace(0.0, math.asinh(math.pi / scale), points))[1:]
    z = np.exp(1j * angle_rad)
    return CircleGrid(angle_rad, z, plant_responses(models, delays_ns, period_ns, z))


def loop_figures(grid: CircleGrid, design: LawDesign) -> LoopFigures:
    """Return the figures of a law around the plants of the grid; meaningless if unstable."""
    law = triangular(law_system(design)).response(grid.z)
    loop = (grid.plants[: len(law)] * law[:, None, None]).sum(axis=0)
    sensitivity = 1.0 / np.abs(1.0 - loop)
    size = np.abs(law[0])
    if len(law) > 1:
        size = np.hypot(size, HEADING_NOISE_1_M * np.abs(law[1]))
    power = np.square(sensitivity * size)
    mean = 0.5 * (power[..., 1:] + power[..., :-1]) @ np.diff(grid.angle_rad) / math.pi
    # Below the first point the power is taken as constant.
    mean += power[..., 0] * grid.angle_rad[0] / math.pi
    return LoopFigures(float(_peak(sensitivity).max()), math.sqrt(mean.max()))


def _peak(size: FloatArray) -> FloatArray:
    """Return the peak over the last axis, of the parabola through the maximum and its neighbours.

    The maximum on the grid is too low for a peak between two points.
    """
    highest = np.clip(size.argmax(axis=-1), 1, size.shape[-1] - 2)[..., None]
    before, top, after = (
        np.take_along_axis(size, highest + step, axis=-1)[..., 0] for step in (-1, 0, 1)
    )
    bend = np.minimum(before - 2.0 * top + after, -1e-12)
    rounded = top - np.square(after - before) / (8.0 * bend)
    # At the ends of the axis the largest value need not be a peak.
    return np.where(top >= np.maximum(before, after), rounded, size.max(axis=-1))
