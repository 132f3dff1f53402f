"""Feedback laws as linear systems that are sampled once a cycle, for the analysis.

    x[k+1] = A x[k] + B u[k]        T[k] = C x[k] + D u[k]        u = (θ, F, T_d)

    T    torque of the feedback against the angle [N m]
    θ    angle of the hand wheel [rad]
    F    the road's torque as it arrives [N m]
    T_d  torque of the driver, by a sensor [N m]

A rate is that of a filtered angle: s ω_d/(s + ω_d). The observers are

    cdob   T = F + d - slow(d)      d = Q (G_n θ - F)                           Q = ω_c/(s + ω_c)
    dob    T = F + d                d = Q ((J_n s + b_n) s θ + T - T_d)

    G_n       nominal way from the wheel's angle to the road's torque, without a bus
    slow      low-pass of the washout: what is slower reaches the hand from the road alone
    J_n, b_n  inertia and damping that the wheel is to have in the driver's hand
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm

from ..wheel import LinearSystem, Matrix, Row, Rows, kept_of


class SampledLaw(NamedTuple):
    """A, B, C and D as above; shapes (n, n), (n, 3), (n,), (3,)."""

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix

    def with_damping(
        self, damping_n_m_s: float, cycle_s: float, cutoff_rad_s: float
    ) -> "SampledLaw":
        """Return the law with damping by the filtered rate."""
        kept, gain = _low_pass(cutoff_rad_s, cycle_s)
        a = block_diag(self.a, kept)
        b = np.vstack((self.b, [1.0 - kept, 0.0, 0.0]))
        c = np.append(self.c, -damping_n_m_s * gain)
        d = self.d + np.array([damping_n_m_s * gain, 0.0, 0.0])
        return SampledLaw(a, b, c, d)


PASS_THROUGH = SampledLaw(
    np.zeros((0, 0)), np.zeros((0, 3)), np.zeros(0), np.array([0.0, 1.0, 0.0])
)  # fmt: skip
"""The road's torque as it arrives."""


def model_alone(road: LinearSystem, cycle_s: float) -> SampledLaw:
    """Return the law that takes the torque of a model, whatever the road's."""
    a, b, c = zero_order_hold(road, cycle_s)
    return SampledLaw(a, np.outer(b, [1.0, 0.0, 0.0]), c, np.zeros(3))


def sampled_cdob(
    nominal: LinearSystem, cycle_s: float, cutoff_rad_s: float = 50.0, washout_rad_s: float = 2.0
) -> SampledLaw:
    """Return a communication disturbance observer; a washout of 0: none."""
    model = zero_order_hold(nominal, cycle_s)
    order = len(model.b)
    kept, kept_slow = kept_of(cutoff_rad_s, cycle_s), kept_of(washout_rad_s, cycle_s)
    a = block_diag(model.a, kept, kept_slow)
    a[order, :order] = (1.0 - kept) * model.c
    a[order + 1, order] = 1.0 - kept_slow
    b = np.zeros((order + 2, 3))
    b[:order, 0], b[order, 1] = model.b, kept - 1.0
    c = np.concatenate((np.zeros(order), [1.0, -1.0]))
    return SampledLaw(a, b, c, PASS_THROUGH.d)


def sampled_dob(
    inertia_kg_m2: float, damping_n_m_s: float, cycle_s: float, cutoff_rad_s: float
) -> SampledLaw:
    """Return a disturbance observer of the wheel; its rate is filtered by ω_c too.

    The observer sees the torque that it makes itself, so it integrates.
    """
    kept = kept_of(cutoff_rad_s, cycle_s)
    direct, integrated = dob_gains(inertia_kg_m2, damping_n_m_s, cycle_s, cutoff_rad_s)
    a = np.array([[kept, 0.0], [-integrated, 1.0]])
    b = np.array([[1.0 - kept, 0.0, 0.0], [integrated, 1.0 - kept, kept - 1.0]])
    return SampledLaw(a, b, np.array([-direct, 1.0]), np.array([direct, 1.0, 0.0]))


def dob_gains(
    inertia_kg_m2: float, damping_n_m_s: float, cycle_s: float, cutoff_rad_s: float
) -> tuple[float, float]:
    """Return torque, and torque added in a cycle, per angle less its low-pass [N m/rad]."""
    kept, gain = _low_pass(cutoff_rad_s, cycle_s)
    return cutoff_rad_s * inertia_kg_m2 * gain, (1.0 - kept) * damping_n_m_s * gain


def zero_order_hold(system: LinearSystem, time_s: float) -> LinearSystem:
    """Return the system sampled every ``time_s``, its input held between."""
    order = len(system.b)
    both = np.zeros((order + 1, order + 1))
    both[:order, :order], both[:order, order] = system.a, system.b
    exponential = expm(both * time_s)
    return LinearSystem(exponential[:order, :order], exponential[:order, order], system.c)


def _low_pass(cutoff_rad_s: float, cycle_s: float) -> tuple[float, float]:
    """Return what a cycle keeps of a low-pass, and the rate per angle less its low-pass [1/s]."""
    kept = kept_of(cutoff_rad_s, cycle_s)
    return kept, (1.0 - kept) / cycle_s


def sampled_model(road: LinearSystem, cycle_s: float) -> tuple[Rows, Row, Row]:
    """Return G_n, with a servo of first order, and its input held for a cycle, as tuples."""
    a, b, c = (part.tolist() for part in zero_order_hold(road, cycle_s))
    return (tuple(a[0]), tuple(a[1]), tuple(a[2])), tuple(b), tuple(c)
