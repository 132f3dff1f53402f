"""Continuous-time loops with an exact delay: what the paper's equations say before any sampling.

    u = (R r - M y)/E,   y = G(s) e^(-sT) u

    pd        u = C (r - y)
    pd_dob    u = u_new - (Q/G_n) y + Q u,  u_new = C (r - y)          SAE 2018-01-1086 (11)
    pd_cdob   u = C (r - y_fb),  y_fb = y + H (G_n Q u - Q y)          its (16) and Figure 6
    pd_ddob   both, the CDOB fed with u_new                            its Figure 13

R, M and E are polynomials in s. Every denominator is cleared, and none that holds a state is
cancelled, so integrators that the law cancels in the plant stay visible: without washout pd_cdob
and pd_ddob have two roots at s = 0 that (18) does not show.

    L   = M G e^(-sT)/E                      loop, cut at the command
    y/r = R G e^(-sT)/(E + M G e^(-sT))      (18) for pd_cdob with G = G_n and H = 1

For design only: python-control gives the margins, and no live program may import it.
"""

from typing import NamedTuple

import numpy as np

from ...closed_loop.parameter_space.root_count import Polynomial, RootCount, count_roots, on_axis
from ...controller.analysis.linear_system import polynomials
from ...controller.filters.continuous_filters import pd_compensator, q_order_2, q_type_2, washout
from ...controller.filters.settings import CdobSettings, DobSettings
from ...controller.filters.transfer_function import Factor, TransferFunction
from ...controller.laws.law_from_settings import required
from ...controller.laws.settings import LawSettings
from ...runtime.array_types import ComplexArray, FloatArray
from .small_gain import CdobParts


class ContinuousLaw(NamedTuple):
    """u = (R r - M y)/E; no PD and no reference for a DOB by itself."""

    reference: Polynomial  # R
    measurement: Polynomial  # M
    denominator: Polynomial  # E


def continuous_law(settings: LawSettings) -> ContinuousLaw:
    """Return the law of the settings as it was designed; their rate plays no part."""
    numerator, denominator = polynomials(pd_compensator(required(settings.pd)))
    law = ContinuousLaw(numerator, numerator, denominator)
    model = settings.model
    needs = settings.law_record.needs
    if model is None:
        return law
    if settings.cdob is not None and "cdob" in needs:
        law = _with_cdob(law, settings.cdob, model)
    if settings.dob is not None and "dob" in needs:
        law = _with_dob(law, dob_q(settings.dob), model)
    return law


def dob_q(dob: DobSettings) -> TransferFunction:
    """Return Q of a disturbance observer."""
    design = q_order_2 if dob.q_kind == "order_2" else q_type_2
    return design(dob.q_cutoff_rad_s)


def dob_alone(q: TransferFunction, model: TransferFunction) -> ContinuousLaw:
    """Return u = r - (Q/G_n) y + Q u, where r is u_new: the loop of (12), (13) and (21)."""
    one = np.ones(1)
    return _with_dob(ContinuousLaw(one, np.zeros(1), one), q, model)


def cdob_parts(settings: LawSettings) -> CdobParts:
    """Return what the small gain condition (25) of the settings' CDOB needs.

    Raises ValueError for a law without one.
    """
    cdob, model = settings.cdob, settings.model
    if cdob is None or model is None:
        raise ValueError(f"law = {settings.law!r} has no CDOB")
    q = washout(cdob.washout_rad_s).times(q_order_2(cdob.q_cutoff_rad_s))
    return CdobParts(pd_compensator(required(settings.pd)), q, model)


def loop_response(
    law: ContinuousLaw, plant: TransferFunction, delay_s: float, omega_rad_s: FloatArray
) -> ComplexArray:
    """Return L at each ω above 0 [rad/s]; -1 is the critical point."""
    s = on_axis(omega_rad_s)
    feedback = np.polyval(law.measurement, s) / np.polyval(law.denominator, s)
    return np.asarray(feedback * plant.response(s) * np.exp(-s * delay_s), np.complex128)


def reference_response(
    law: ContinuousLaw, plant: TransferFunction, delay_s: float, omega_rad_s: FloatArray
) -> ComplexArray:
    """Return y/r at each ω above 0 [rad/s]; y/u_new of (12) for ``dob_alone``."""
    s = on_axis(omega_rad_s)
    forward = np.polyval(law.reference, s) / np.polyval(law.denominator, s)
    delayed = plant.response(s) * np.exp(-s * delay_s)
    loop = loop_response(law, plant, delay_s, omega_rad_s)
    return np.asarray(forward * delayed / (1.0 + loop), np.complex128)


def closed_loop_roots(law: ContinuousLaw, plant: TransferFunction, delay_s: float) -> RootCount:
    """Return all roots of law and plant, including those that cancel in L.

    Raises ValueError where the loop is not strictly proper.
    """
    numerator, denominator = polynomials(plant)
    return count_roots(
        product(law.denominator, denominator), product(law.measurement, numerator), delay_s
    )


def _with_cdob(pd: ContinuousLaw, cdob: CdobSettings, model: TransferFunction) -> ContinuousLaw:
    """Return u = C (r - y + H Q y - H G_n Q u) for C of ``pd``."""
    filter_h, q = washout(cdob.washout_rad_s), q_order_2(cdob.q_cutoff_rad_s)
    compensation = filter_h.times(model)  # powers of s cancel here, as integers
    q_numerator, q_denominator = polynomials(q)
    n, d = polynomials(compensation)
    hq_numerator, hq_denominator = polynomials(filter_h.times(q))
    _, model_poles = polynomials(compensation._replace(denominator=model.denominator))
    observed = _sum(hq_denominator, -hq_numerator)
    return ContinuousLaw(
        reference=product(pd.reference, q_denominator, d),
        measurement=product(pd.measurement, observed, model_poles),
        denominator=_sum(
            product(pd.denominator, q_denominator, d), product(pd.measurement, n, q_numerator)
        ),
    )


def _with_dob(law: ContinuousLaw, q: TransferFunction, model: TransferFunction) -> ContinuousLaw:
    """Return u = u_new - (Q/G_n) y + Q u for u_new of ``law``."""
    q_numerator, q_denominator = polynomials(q)
    numerator, denominator = polynomials(q.times(model.inverse()))
    model_zeros, _ = polynomials(model)
    lacking = _sum(q_denominator, -q_numerator)
    return ContinuousLaw(
        reference=product(law.reference, denominator),
        measurement=_sum(
            product(law.measurement, denominator), product(law.denominator, numerator)
        ),
        denominator=product(law.denominator, lacking, model_zeros),
    )


def _sum(one: Polynomial, other: Polynomial) -> Polynomial:
    """Return the sum; what cancels exactly is exactly zero."""
    return np.asarray(np.polyadd(one, other), np.float64)


def product(*polynomials: Polynomial | Factor) -> Polynomial:
    """Return the product, without leading zeros."""
    product = np.ones(1)
    for polynomial in polynomials:
        product = np.convolve(product, _without_leading_zeros(np.array(polynomial)))
    return product[len(product) :] if not product.any() else _without_leading_zeros(product)


def _without_leading_zeros(polynomial: Polynomial) -> Polynomial:
    """Return the polynomial from its highest power on, of 0 the last coefficient."""
    return polynomial[np.argmax(polynomial != 0.0) if polynomial.any() else -1 :]
