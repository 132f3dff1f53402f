"""Second-order sections: every observer and controller here consists of these filters.

    y[k] = b0 u[k] + b1 u[k-1] + b2 u[k-2] - a1 y[k-1] - a2 y[k-2]

The form is direct form II transposed, which keeps two state values and adds them in the order with
the least rounding error. Coefficients and state are plain floats in tuples. The steps have no
imports and no branches, so the same functions run interpreted in the live program and compiled in
batches. Both are plain tuples, which are built and unpacked in a third of a NamedTuple's time.

A cascade of 1, 2 or 3 sections is written out instead of looped over: sizes are then part of the
type, which a compiler needs and which also is the fastest form interpreted.
"""

Section = tuple[float, float, float, float, float]
"""Coefficients b0, b1, b2, a1, a2 of one second-order section, normalised to a0 = 1."""

IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0)
"""Passes its input through; fills unused places of a cascade."""

SectionState = tuple[float, float]

Cascade2 = tuple[Section, Section]
Cascade3 = tuple[Section, Section, Section]
Cascade2State = tuple[SectionState, SectionState]
Cascade3State = tuple[SectionState, SectionState, SectionState]


def section_step(p: Section, x: SectionState, u: float) -> tuple[SectionState, float]:
    """Advance one period with input u; returns the new state and the output."""
    b0, b1, b2, a1, a2 = p
    x1, x2 = x
    y = b0 * u + x1
    return (b1 * u - a1 * y + x2, b2 * u - a2 * y), y


def cascade_2_step(p: Cascade2, x: Cascade2State, u: float) -> tuple[Cascade2State, float]:
    """Advance two sections in series by one period; returns the new state and the output."""
    (b0, b1, b2, a1, a2), (c0, c1, c2, d1, d2) = p
    (x1, x2), (z1, z2) = x
    v = b0 * u + x1
    y = c0 * v + z1
    return ((b1 * u - a1 * v + x2, b2 * u - a2 * v), (c1 * v - d1 * y + z2, c2 * v - d2 * y)), y


def cascade_3_step(p: Cascade3, x: Cascade3State, u: float) -> tuple[Cascade3State, float]:
    """Advance three sections in series by one period; returns the new state and the output."""
    (b0, b1, b2, a1, a2), (c0, c1, c2, d1, d2), (e0, e1, e2, f1, f2) = p
    (x1, x2), (z1, z2), (s1, s2) = x
    v = b0 * u + x1
    w = c0 * v + z1
    y = e0 * w + s1
    return (
        (b1 * u - a1 * v + x2, b2 * u - a2 * v),
        (c1 * v - d1 * w + z2, c2 * v - d2 * w),
        (e1 * w - f1 * y + s2, e2 * w - f2 * y),
    ), y


def section_at_rest(p: Section, u: float) -> tuple[SectionState, float]:
    """Return the steady state for a constant input u, and the constant output.

    A section with a pole at z = 1 (an integrator) is at rest only with u = 0, and its state is then
    zero. Any other input raises ValueError.
    """
    b0, b1, b2, a1, a2 = p
    denominator = 1.0 + a1 + a2
    if denominator == 0.0:
        if u != 0.0:
            raise ValueError(f"an integrator does not come to rest with the constant input {u}")
        return (0.0, 0.0), 0.0
    y = (b0 + b1 + b2) / denominator * u
    x2 = b2 * u - a2 * y
    return (b1 * u - a1 * y + x2, x2), y


def cascade_2_at_rest(p: Cascade2, u: float) -> tuple[Cascade2State, float]:
    """Return the state of two sections in series after a constant input u, and the output."""
    x0, v = section_at_rest(p[0], u)
    x1, y = section_at_rest(p[1], v)
    return (x0, x1), y


def cascade_3_at_rest(p: Cascade3, u: float) -> tuple[Cascade3State, float]:
    """Return the state of three sections in series after a constant input u, and the output."""
    x0, v = section_at_rest(p[0], u)
    x1, w = section_at_rest(p[1], v)
    x2, y = section_at_rest(p[2], w)
    return (x0, x1, x2), y
