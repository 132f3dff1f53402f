"""Small functions of C for what Python has built in; a file has those that it calls."""

import re
from collections.abc import Mapping

HELPERS: Mapping[str, str] = {
    "is_finite": """\
static bool is_finite(double x)
{
    if (x != x) /* not a number; by itself, so that Frama-C follows it */
        return false;
    return x >= -DBL_MAX && x <= DBL_MAX;
}
""",
    "is_nan": """\
static bool is_nan(double x)
{
    return x != x;
}
""",
    "magnitude": """\
static double magnitude(double x)
{
    return x <= 0.0 ? 0.0 - x : x;
}
""",
    "floor_div": """\
static int64_t floor_div(int64_t x, int64_t by)
{
    return x / by - (x % by != 0 && (x < 0) != (by < 0) ? 1 : 0);
}
""",
    "floor_mod": """\
static int64_t floor_mod(int64_t x, int64_t by)
{
    return x % by + (x % by != 0 && (x < 0) != (by < 0) ? by : 0);
}
""",
    "nearest": """\
static int64_t nearest(double x) /* halves to even */
{
    const int64_t truncated = (int64_t)x;
    const int64_t below = truncated - (x < (double)truncated ? 1 : 0);
    const double above = x - (double)below;

    return below + (above > 0.5 || (above == 0.5 && below % 2 != 0) ? 1 : 0);
}
""",
    "none": """\
static double none(void) /* no number, for a number that is not known */
{
    const double zero = 0.0;

    return zero / zero;
}
""",
    **{
        f"{name}{suffix}": f"""\
static {kind} {name}{suffix}({kind} one, {kind} other)
{{
    return other {sign} one ? other : one;
}}
"""
        for name, sign in (("min", "<"), ("max", ">"))
        for suffix, kind in (("", "double"), ("_int", "int64_t"))
    },
}


def called_by(definitions: str) -> str:
    """Return the helpers that some definitions call."""
    return "\n".join(it for name, it in HELPERS.items() if re.search(rf"\b{name}\(", definitions))
