"""The continuous filters of the paper's laws: C of the PD, Q of the observers, H of the CDOB."""

from .settings import PdSettings
from .transfer_function import Factor, TransferFunction


def pd_compensator(pd: PdSettings) -> TransferFunction:
    """Return C(s) = K_p + K_d s/(s/N + 1) [rad/m], improper where the derivative is ideal."""
    k_p, k_d = pd.proportional_gain_rad_m, pd.derivative_gain_rad_s_m
    if pd.derivative_filter_rad_s is None:
        return TransferFunction(0, (Factor(0.0, k_d, k_p),), ())
    filter_s = 1.0 / pd.derivative_filter_rad_s
    zeros, poles = Factor(0.0, k_p * filter_s + k_d, k_p), Factor(0.0, filter_s, 1.0)
    return TransferFunction(0, (zeros,), (poles,))


def q_order_2(omega_rad_s: float) -> TransferFunction:
    """Return Q = 1/(τs + 1)² with τ = 1/ω, (20)."""
    tau_s = 1.0 / omega_rad_s
    return TransferFunction(0, (), (Factor(tau_s**2, 2.0 * tau_s, 1.0),))


def q_type_2(omega_rad_s: float) -> TransferFunction:
    """Return Q = (3τs + 1)/(τs + 1)³ with τ = 1/ω; not in paper."""
    tau_s = 1.0 / omega_rad_s
    return TransferFunction(
        0,
        (Factor(0.0, 3.0 * tau_s, 1.0),),
        (Factor(tau_s**2, 2.0 * tau_s, 1.0), Factor(0.0, tau_s, 1.0)),
    )


def washout(omega_rad_s: float | None) -> TransferFunction:
    """Return H = (s/(s + ω))², not in paper, or H = 1 for None."""
    if omega_rad_s is None:
        return TransferFunction(0, (), ())
    return TransferFunction(2, (), (Factor(1.0, 2.0 * omega_rad_s, omega_rad_s**2),))
