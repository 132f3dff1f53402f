"""The car along a path in the sampled loop without limits, for many plants at once.

    y = y_ρ + P u,   u = K y      so      Y(z) = Y_ρ(z) / (1 - P(z) K(z)),   U(z) = K(z) Y(z)

and where a law reads the heading error ψ = ψ_ρ + P_ψ u too, u = K y + K_ψ ψ:

    U(z) = (K Y_ρ + K_ψ Ψ_ρ) / (1 - P K - P_ψ K_ψ),   Y = Y_ρ + P U

    y    lateral error at the control ticks                                      [m]
    y_ρ  the same without steering: (5), -V² ∫∫ ρ dt², ρ the path's curvature    [m]
    ψ_ρ  heading error without steering: -V ∫ ρ dt                               [rad]
    P    plant behind the hold and a constant delay, at the ticks
    K    law, its own command fed back as sent

Everything is evaluated on the circle |z| = R > 1 and taken back to time by inverse FFT:

    y[k] = R^k · ifft(Y(R e^{2πi j/M}))[k]

The unit circle itself does not work, since plant and y_ρ have their double integrators there. What
comes later than M ticks wraps around to the beginning, multiplied by R^-M, and rounding is
multiplied by R^k: R is a compromise between the two. y_ρ may stop at the end of the run, because
the loop is causal; M leaves the loop some time to settle after that.

A steer that is added to the law's without feedback, such as that for the map's curvature, passes
the same plant: Y_ρ + P U_added takes the place of Y_ρ. A law with a set point y* sees E = Y - Y*,
for which Y_ρ - Y* takes the place of Y_ρ.

The centre of gravity lies d behind the preview point, where the path has bent away from its tangent
by g. With small angles its deviation is

    y_cg = y - d ψ - g,   g = ∫ (d - w) ρ(s - w) dw over w from 0 to d

The small angles leave out a share |y ρ| of the offset: 2 % where the preview point is 0.3 m off in
a bend of 15 m, less than 0.3 mm of the RMS on the ellipse of 60 by 30 m. Limits, quantisation and
jitter are left out too; everything else is exact.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from ...controller.analysis.linear_system import triangular_law
from ...controller.filters.transfer_function import TransferFunction
from ...controller.laws.law_from_settings import LawDesign
from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from .loop_figures import fed_back, plant_responses

_LATE_FACTOR = 1e-8
"""R^-M, the factor of what comes after the M ticks; rounding grows by at most its inverse."""
_ROOM = 1.3
"""Ticks of the transform per tick of the run."""


class TrackingGrid(NamedTuple):
    """Plants and paths on the circle |z| = R; Z of its points suffice, the rest being conjugate.

    ``plants``     P and P_ψ, shape (2, corners, delays, Z)
    ``unsteered``  Y_ρ - Y* and Ψ_ρ, shape (2, paths, corners, Z)
    ``offset_m``   y* - d ψ_ρ - g in time, shape (paths, corners, ticks)
    ``preview_m``  d; 0 to judge the law's error instead of the car
    ``added``      steer that is added to the law's, shape (paths, corners, Z); 0 for none
    ``first_tick``  the first one that counts; before it the run settles
    """

    period_ns: int
    ticks: int
    transform: int  # M
    growth: FloatArray  # R^k for every tick of the run, shape (ticks,)
    z: ComplexArray
    plants: ComplexArray
    unsteered: ComplexArray
    added: ComplexArray
    offset_m: FloatArray
    preview_m: float
    first_tick: int


class Tracking(NamedTuple):
    """The results of a law on the paths of a grid; each of shape (paths, corners, delays).

    ``rms_m``            of the car's deviation over the ticks that count [m]
    ``steer_rad``        largest |steer| [rad]
    ``steer_rate_rad_s``  largest change of the command from tick to tick, per second [rad/s]
    """

    rms_m: FloatArray
    steer_rad: FloatArray
    steer_rate_rad_s: FloatArray


def unsteered_errors(
    curvature_1_m: FloatArray, interval_s: float, speed_m_s: float, stride: int
) -> FloatArray:
    """Return y_ρ and ψ_ρ at every ``stride``-th sample of the curvature at constant speed, (5).

    ``curvature_1_m``  ρ at 0, interval, 2 interval, ..., taken as linear in between

    The vehicle starts on the path, with no lateral speed.
    """
    earlier, later = curvature_1_m[:-1], curvature_1_m[1:]
    slope = _accumulated(0.5 * interval_s * (earlier + later))
    moved = interval_s * slope[:-1] + interval_s**2 * (2.0 * earlier + later) / 6.0
    error_m = -(speed_m_s**2) * _accumulated(moved)[::stride]
    return np.stack([error_m, -speed_m_s * slope[::stride]])


def tracking_grid(
    models: Sequence[TransferFunction],
    unsteered: FloatArray,
    delays_ns: Sequence[int],
    period_ns: int,
    first_tick: int = 1,
    added_rad: FloatArray | None = None,
    offset_m: FloatArray | None = None,
    preview_m: float = 0.0,
) -> TrackingGrid:
    """Return the part of the computation that is the same for every law.

    ``models``       plants from steer to lateral error, one for each corner
    ``unsteered``    y_ρ - y* and ψ_ρ at the ticks from 0 on, shape (2, paths, corners, ticks)
    ``first_tick``   the first one that counts; before it the run settles
    ``added_rad``    steer that is added to the law's at the ticks, shape (paths, corners, ticks);
                     None: none
    ``offset_m``, ``preview_m``  as in the grid; None and 0 for the law's error
    """
    ticks = unsteered.shape[-1]
    transform = int(next_fast_len(math.ceil(_ROOM * ticks), real=True))
    log_radius = -math.log(_LATE_FACTOR) / transform
    points = np.arange(transform // 2 + 1)
    z = np.exp(log_radius + 2j * math.pi * points / transform)
    growth = np.exp(log_radius * np.arange(ticks))
    on_circle = rfft(unsteered / growth, transform)
    zeros = np.zeros_like(on_circle[0])
    added = zeros if added_rad is None else rfft(added_rad / growth, transform)
    plants = plant_responses(models, delays_ns, period_ns, z)
    offset_m = np.zeros_like(unsteered[0]) if offset_m is None else offset_m
    return TrackingGrid(
        *(period_ns, ticks, transform, growth, z, plants, on_circle, added),
        *(offset_m, preview_m, first_tick),
    )


def track(grid: TrackingGrid, design: LawDesign) -> Tracking:
    """Return error and steer of a law on every path, corner and delay of the grid.

    The result is meaningless where the loop is unstable.
    """
    rate_hz, before = NS_PER_S / grid.period_ns, grid.first_tick - 1
    figures = []
    for path_m, steer in _deviations_and_steers(grid, design):
        steer_rad = _in_time(grid, steer)
        steps_rad = np.abs(np.diff(steer_rad, axis=-1, prepend=0.0))
        peaks = (np.abs(steer_rad), steps_rad * rate_hz)
        figures.append((_rms(grid, path_m), *(peak[..., before:].max(axis=-1) for peak in peaks)))
    return Tracking(*(np.stack(of_paths) for of_paths in zip(*figures, strict=True)))


def rms_m(grid: TrackingGrid, design: LawDesign) -> FloatArray:
    """Return the RMS alone, in half the time; shape (paths, corners, delays) [m]."""
    return _rms(grid, deviation_m(grid, design))


def deviation_m(grid: TrackingGrid, design: LawDesign) -> FloatArray:
    """Return the car's deviation at every tick, shape (paths, corners, delays, ticks) [m]."""
    return np.stack([path_m for path_m, _ in _deviations_and_steers(grid, design)])


def _deviations_and_steers(
    grid: TrackingGrid, design: LawDesign
) -> Iterator[tuple[FloatArray, ComplexArray]]:
    """Yield for path after path the deviation in time, and the steer on the circle."""
    law = triangular_law(design).response(grid.z)
    sensitivity = 1.0 / (1.0 - fed_back(grid.plants, law))
    for *unsteered, added, offset_m in zip(*grid.unsteered, grid.added, grid.offset_m, strict=True):
        if len(law) == 1:
            error = (unsteered[0][:, None] + grid.plants[0] * added[:, None]) * sensitivity
            steer = law[0] * error + added[:, None]
        else:
            asked = sum(k * error for k, error in zip(law, unsteered, strict=True)) + added
            steer = asked[:, None] * sensitivity
            error = unsteered[0][:, None] + grid.plants[0] * steer
        turned = error - grid.preview_m * grid.plants[1] * steer if grid.preview_m else error
        yield _in_time(grid, turned) + offset_m[:, None], steer


def _in_time(grid: TrackingGrid, on_circle: ComplexArray) -> FloatArray:
    """Return the samples of the run, last axis from (Z,) to (ticks,)."""
    damped = irfft(on_circle, grid.transform)[..., : grid.ticks]
    return np.asarray(damped * grid.growth, dtype=np.float64)


def _rms(grid: TrackingGrid, samples: FloatArray) -> FloatArray:
    later = samples[..., grid.first_tick :]
    return np.asarray(np.sqrt(np.einsum("...k,...k->...", later, later) / later.shape[-1]))


def _accumulated(steps: FloatArray) -> FloatArray:
    """Return the running sum, starting with 0."""
    return np.concatenate(([0.0], np.cumsum(steps)))
