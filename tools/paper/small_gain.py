"""Robust stability by the small gain theorem: SAE 2018-01-1086 (6) and (23) to (27).

    DOB     |Q(jω) Δ_m(jω)| < 1 for all ω,   Δ_m = (G - G_n)/G_n                       (23)

    CDOB    |L_n/(1 + L_n) Δ_m| < 1 for all ω,   Δ_m = e^(-jωT) - 1              (25), (27)
            L_n = C (1 - Q) G_n/(1 + C G_n Q),   so  L_n/(1 + L_n) = (1 - Q) C G_n/(1 + C G_n)

(17), (18) print e^(-T) for e^(-Ts), and (26) has a factor e^(-Ts) in L_n too many: with Δ_m the
delay, L_n (1 + Δ_m) is the loop, so L_n must not contain the delay a second time. The delay is
exact, no Padé.

The conditions are sufficient and not necessary: they compare magnitudes and ignore phases. A loop
that meets one is stable, if it is stable for Δ_m = 0; a loop that fails it may be stable as well.
The exact answer is in ``controller.analysis.sampled_loop``.
"""

from typing import NamedTuple

import numpy as np

from ...controller.analysis.sampled_loop import peak_of
from ...controller.filters.continuous_filters import pd_compensator, q_order_2, washout
from ...controller.filters.transfer_function import TransferFunction
from ...controller.laws.law_from_settings import required
from ...controller.laws.settings import LawSettings
from ...runtime.array_types import ComplexArray, FloatArray

OMEGA_RAD_S = np.geomspace(1e-3, 1e5, 10_000)


class Peak(NamedTuple):
    """Largest magnitude of a response, and the ω where it is reached [rad/s]."""

    size: float
    omega_rad_s: float


class CdobParts(NamedTuple):
    """The transfer functions in (26)."""

    compensator: TransferFunction  # C [rad/m]
    q: TransferFunction  # Q, or H Q where there is a washout H
    model: TransferFunction  # G_n [m/rad]


def cdob_parts(settings: LawSettings) -> CdobParts:
    """Return what the small gain condition (25) of the settings' CDOB needs.

    Raises ValueError for a law without one.
    """
    cdob, model = settings.cdob, settings.model
    if cdob is None or model is None:
        raise ValueError(f"law = {settings.law!r} has no CDOB")
    q = washout(cdob.washout_rad_s).times(q_order_2(cdob.q_cutoff_rad_s))
    return CdobParts(pd_compensator(required(settings.pd)), q, model)


def on_axis(omega_rad_s: FloatArray) -> ComplexArray:
    """Return s = jω."""
    return np.asarray(1j * omega_rad_s, np.complex128)


def multiplicative_uncertainty(
    plant: TransferFunction, model: TransferFunction, omega_rad_s: FloatArray
) -> ComplexArray:
    """Return Δ_m of (6) at each ω above 0."""
    ratio = plant.times(model.inverse()).response(on_axis(omega_rad_s))
    return np.asarray(ratio - 1.0, np.complex128)


def condition_23(q: TransferFunction, plant: TransferFunction, model: TransferFunction) -> Peak:
    """Return the largest |Q Δ_m|: the condition is met where it is below 1."""

    def size(omega_rad_s: FloatArray) -> FloatArray:
        uncertainty = multiplicative_uncertainty(plant, model, omega_rad_s)
        return np.abs(q.response(on_axis(omega_rad_s)) * uncertainty)

    return Peak(*peak_of(size, OMEGA_RAD_S))


def delay_uncertainty(omega_rad_s: FloatArray, delay_s: float) -> ComplexArray:
    """Return Δ_m = e^(-jωT) - 1 of (27), of size 2 |sin(ωT/2)|."""
    return np.asarray(np.expm1(-on_axis(omega_rad_s) * delay_s), np.complex128)


def cdob_nominal_loop(parts: CdobParts, omega_rad_s: FloatArray) -> ComplexArray:
    """Return L_n of (26) at each ω above 0."""
    s = on_axis(omega_rad_s)
    c_model = parts.compensator.times(parts.model).response(s)
    q = parts.q.response(s)
    return np.asarray(c_model * (1.0 - q) / (1.0 + c_model * q), np.complex128)


def cdob_small_gain(parts: CdobParts, delay_s: float) -> Peak:
    """Return the largest |L_n/(1 + L_n) Δ_m| of (25): the condition is met where it is below 1."""

    def size(omega_rad_s: FloatArray) -> FloatArray:
        nominal = cdob_nominal_loop(parts, omega_rad_s)
        return np.abs(nominal / (1.0 + nominal) * delay_uncertainty(omega_rad_s, delay_s))

    return Peak(*peak_of(size, OMEGA_RAD_S))
