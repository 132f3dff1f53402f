"""Kalman filter of two coefficients that walk slowly: value = a h_a + b h_b + noise."""

Coefficients = tuple[float, float, float, float, float]
"""a, b, and their variances: of a, of both, of b."""


def regressed(
    x: Coefficients, h_a: float, h_b: float, value: float, noise_variance: float
) -> Coefficients:
    """Return the coefficients corrected by a value."""
    a, b, p_aa, p_ab, p_bb = x
    to_a, to_b = p_aa * h_a + p_ab * h_b, p_ab * h_a + p_bb * h_b
    variance = noise_variance + h_a * to_a + h_b * to_b
    if variance == 0.0:
        return x
    error = value - (a * h_a + b * h_b)
    return (
        a + to_a / variance * error,
        b + to_b / variance * error,
        p_aa - to_a * to_a / variance,
        p_ab - to_a * to_b / variance,
        p_bb - to_b * to_b / variance,
    )
