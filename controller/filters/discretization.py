"""The filters of the paper's law: the one place where continuous filters become discrete.

    driven by the command, which is held between ticks:   hold equivalent (zero-order hold)
    driven by samples of the error:                       Tustin (trapezoidal rule)
    ideal derivative:                                     backward difference

The hold equivalent is exact for a held input, and its output at a tick depends on the commands of
earlier ticks only, so feeding it the last command sent leaves no algebraic loop and no lost period.
It lags the continuous Q by half a period, just as the vehicle behind the hold lags G: in
d̂ = (Q/G_n) y - Q u the two lags cancel. With Tustin for Q u they would not, and the observer would
take the half period for a disturbance (at 100 Hz and 2 rad/s that is below 1 % of the tracking
error; it grows with cutoff times period).

Tustin maps s = 0 to z = 1, so Q/G_n, H and G_n keep exactly the zeros and integrators at rest that
they were designed with.
"""

from math import exp, expm1

from .cdob import CdobParams
from .continuous_filters import pd_compensator, q_order_2, q_type_2, washout
from .dob import DobParams
from .pd_filter import PdParams
from .sections import IDENTITY, Cascade2, Section
from .settings import CdobSettings, DobSettings, PdSettings
from .transfer_function import Factor, TransferFunction


def design_pd(settings: PdSettings | None, period_s: float) -> PdParams:
    """Return C(z); raises ValueError for settings without [pd]."""
    if settings is None:
        raise ValueError("the law needs the table [pd]")
    if settings.derivative_filter_rad_s is None:
        k_p, k_d = settings.proportional_gain_rad_m, settings.derivative_gain_rad_s_m
        return PdParams((k_p + k_d / period_s, -k_d / period_s, 0.0, 0.0, 0.0))
    return PdParams(*tustin_sections(pd_compensator(settings), period_s))


def design_dob(settings: DobSettings, model: TransferFunction, period_s: float) -> DobParams:
    """Return the filters Q and Q/G_n of the disturbance observer."""
    omega_rad_s = settings.q_cutoff_rad_s
    if settings.q_kind == "order_2":
        q = q_order_2(omega_rad_s)
        command_filter: Cascade2 = (hold_equivalent_order_2(omega_rad_s, period_s), IDENTITY)
    else:
        q = q_type_2(omega_rad_s)
        command_filter = hold_equivalent_type_2(omega_rad_s, period_s)
    first, *more = tustin_sections(q.times(model.inverse()), period_s)
    second, third, *_ = (*more, IDENTITY, IDENTITY)
    return DobParams(command_filter, (first, second, third))


def design_cdob(settings: CdobSettings, model: TransferFunction, period_s: float) -> CdobParams:
    """Return the filters Q, Q/G_n and H G_n of the communication disturbance observer."""
    q = q_order_2(settings.q_cutoff_rad_s)
    return CdobParams(
        hold_equivalent_order_2(settings.q_cutoff_rad_s, period_s),
        _two_sections(q.times(model.inverse()), period_s),
        design_compensation(model, settings.washout_rad_s, period_s),
    )


def design_compensation(
    model: TransferFunction, washout_rad_s: float | None, period_s: float
) -> Cascade2:
    """Return H G_n, or G_n without a washout."""
    return _two_sections(washout(washout_rad_s).times(model), period_s)


def _two_sections(transfer: TransferFunction, period_s: float) -> Cascade2:
    first, second, *_ = (*tustin_sections(transfer, period_s), IDENTITY)
    return first, second


def tustin(numerator: Factor, denominator: Factor, period_s: float) -> Section:
    """Return one proper quotient of quadratics with s replaced by (2/T)(z - 1)/(z + 1)."""
    order = denominator.degree
    b0, b1, b2 = _tustin_factor(numerator, order, period_s)
    a0, a1, a2 = _tustin_factor(denominator, order, period_s)
    return b0 / a0, b1 / a0, b2 / a0, a1 / a0, a2 / a0


def tustin_sections(transfer: TransferFunction, period_s: float) -> tuple[Section, ...]:
    """Return the sections of a transfer function; Tustin of each is Tustin of the product."""
    return tuple(tustin(zeros, poles, period_s) for zeros, poles in transfer.biquads())


def hold_equivalent_order_2(omega_rad_s: float, period_s: float) -> Section:
    """Return Q of (20) for a held input, its inherent period of delay taken off.

    Step response 1 - (1 + x) e^(-x), x = ωt; fed with u[k-1] the section gives the value at tick k.
    """
    x = omega_rad_s * period_s
    pole, gap = exp(-x), -expm1(-x)  # gap = 1 - pole without cancellation at small x
    b0 = gap - x * pole
    return b0, gap**2 - b0, 0.0, -2.0 * pole, pole**2


def hold_equivalent_type_2(omega_rad_s: float, period_s: float) -> Cascade2:
    """Return the type-2 Q for a held input, its inherent period of delay taken off.

    Step response 1 - (1 + x - x²) e^(-x), x = ωt. The numerator follows from its values after one
    and two periods and from the gain 1 at rest.
    """
    x = omega_rad_s * period_s
    pole, gap = exp(-x), -expm1(-x)
    after_one = gap - (x - x**2) * pole
    after_two = -expm1(-2.0 * x) - (2.0 * x - 4.0 * x**2) * pole**2
    b0 = after_one
    b1 = after_two - after_one - 3.0 * pole * after_one
    b2 = gap**3 - b0 - b1
    return (b0, b1, b2, -2.0 * pole, pole**2), (1.0, 0.0, 0.0, -pole, 0.0)


def _tustin_factor(factor: Factor, order: int, period_s: float) -> tuple[float, float, float]:
    """Return factor((2/T)(z - 1)/(z + 1)) (z + 1)^order z^(-order), by powers of 1/z.

    Numerator and denominator are multiplied by the section's own order of (z + 1), not always by
    order 2: a common factor z + 1 left over would be a cancelled pole on the unit circle.
    """
    c2 = factor.s2 * (2.0 / period_s) ** 2
    c1 = factor.s1 * (2.0 / period_s)
    c0 = factor.s0
    if order == 2:
        return c2 + c1 + c0, 2.0 * (c0 - c2), c2 - c1 + c0
    if order == 1:
        return c1 + c0, c0 - c1, 0.0
    return c0, 0.0, 0.0
