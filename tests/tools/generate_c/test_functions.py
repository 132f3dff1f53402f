"""Functions that become C, and those that are refused with their file and line."""

import ast
import textwrap
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.controller.limits.fades_and_ramps import ramp_step
from steer_by_wire.runtime.exit_status import UserError
from steer_by_wire.tools.generate_c.functions import Function
from steer_by_wire.tools.generate_c.sources import Source, reached, records_of

Pair = tuple[float, float]


class Gains(NamedTuple):
    """A record."""

    first: float
    second: float


class Phase(IntEnum):
    """An enumeration."""

    OFF = 0
    ON = 1


def is_small(n: int) -> bool:
    """Whether it is."""
    return n < 3


TABLE = {Phase.OFF: ((is_small, Phase.ON),), Phase.ON: ()}
HEAD = (
    "def f(a: float, b: float, p: Gains, x: Pair, is_so: bool, n: int, by: int, "
    "maybe: float | None, m: Phase) -> float:"
)


def statements(body: str, head: str = HEAD) -> list[str]:
    """Return the statements of a function as C."""
    text = f"{head}\n    'It.'\n{textwrap.indent(textwrap.dedent(body).strip(), '    ')}\n"
    names: dict[str, Any] = {
        "Gains": Gains, "Pair": Pair, "Phase": Phase, "ramp_step": ramp_step, "GAIN": 0.5,
        "TABLE": TABLE,
    }  # fmt: skip
    exec(text, names)  # noqa: S102
    (tree,) = ast.parse(text).body
    assert isinstance(tree, ast.FunctionDef)
    source = Source(names["f"], tree, "f.py", 1)
    translated = Function(source, records_of([source, *reached([ramp_step])])).definition()
    return [line.strip() for line in translated.partition("\n{\n")[2].splitlines()[:-1]]


def expressions() -> st.SearchStrategy[str]:
    leaves = st.sampled_from(["a", "b", "1.0", "2.0"])

    def larger(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        pairs = st.tuples(inner, st.sampled_from("+-*"), inner)
        return st.one_of(pairs.map(lambda it: "({} {} {})".format(*it)), inner.map("(-{})".format))

    return st.recursive(leaves, larger, max_leaves=12)


@given(expressions(), expressions(), st.sampled_from(["<", "<=", ">", ">=", "==", "!="]))
def test_an_expression_keeps_its_tree(one: str, other: str, sign: str) -> None:
    """C and Python agree on + - * and comparisons, so its text is read again as Python."""
    compared = f"{one} {sign} {other}"
    (line,) = statements(f"return {compared}", HEAD.replace("-> float", "-> bool"))
    text = line.removeprefix("return ").removesuffix(";")
    assert ast.dump(ast.parse(text)) == ast.dump(ast.parse(compared))


@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        ("return a if a < b else -b", ["return a < b ? a : -b;"]),
        ("return p.first * x[1] + GAIN",
         ["return p->first * x->second + 0x1.0000000000000p-1 /* 0.5 */;"]),
        ("k, _d = p\nreturn k",
         ["const double k = p->first;", "const double _d = p->second;", "return k;"]),
        ("c = a\nif is_so:\n  c = -b\nreturn c",
         ["double c = a;", "if (is_so) {", "c = -b;", "}", "return c;"]),
        ("if not is_so:\n  return a\nreturn ramp_step(a, b)",
         ["if (!is_so) {", "return a;", "}", "return ramp_step(a, b);"]),
        ("if a == 0.0:\n  return b\nreturn b / a",
         ["if (a == 0.0) {", "return b;", "}", "return b / a;"]),
        ("if a == 0.0 or b == 0.0:\n  return b\nreturn 1.0 / a / b",
         ["if (a == 0.0 || b == 0.0) {", "return b;", "}", "return 1.0 / a / b;"]),
        ("return a if is_so and (n == 2 or m is Phase.ON) else -1.0",
         ["return is_so && (n == 2 || m == PHASE_ON) ? a : -1.0;"]),
        ("return max(a, b) + float(min(n, by - 5_000_000_000))",
         ["return max(a, b) + (double)min_int(n, by - INT64_C(5000000000));"]),
        ("return float(n % 256 // 3) / p.first",
         ["return (double)floor_div(floor_mod(n, 256), 3) / p->first;"]),
        ("return b if maybe is not None and 0.0 < maybe <= a else abs(b)",
         ["return !is_nan(maybe) && (0.0 < maybe && maybe <= a) ? b : magnitude(b);"]),
        ("q = p._replace(second=a)\nreturn q.second",
         ["const struct gains q = (struct gains){p->first, a};", "return q.second;"]),
        ("c = a\nwhile c > b:\n  c = c - 1.0\nreturn c",
         ["double c = a;", "while (c > b) {", "c = c - 1.0;", "}", "return c;"]),
        ("for guard, then in TABLE[m]:\n  if guard(n):\n    return float(then)\nreturn a",
         ["if (m == PHASE_OFF) {", "if (is_small(n)) {", "return (double)PHASE_ON;", "}", "}",
          "if (m == PHASE_ON) {", "}", "return a;"]),
    ],
)  # fmt: skip
def test_it_becomes_what_a_reader_expects(body: str, wanted: list[str]) -> None:
    assert statements(body) == wanted


@pytest.mark.parametrize(
    ("body", "line", "why"),
    [
        ("return a / b", 3, "a division by b, which may be 0"),
        ("return a ** 2.0", 3, "BinOp 'a ** 2.0'"),
        ("return a * 2", 3, "'2' is no double"),
        ("return float(n // by)", 3, "a division by by, which may be 0"),
        ("return a if is_so and n else b", 3, "'n' is no bool"),
        ("return a + is_so", 3, "'is_so' is no double"),
        ("return a if a else b", 3, "'a' is no bool"),
        ("return max(a, n)", 3, "'n' is no double"),
        ("return max(a, b, 1.0)", 3, "Call 'max(a, b, 1.0)'"),
        ("return p.third", 3, "there is no field third"),
        ("return x", 3, "'x' is no double"),
        ("return ramp_step(a)", 3, "another number of arguments"),
        ("return ramp_step(step=a, value=b)", 3, "Call 'ramp_step(step=a, value=b)'"),
        ("c = a\nfor _ in range(3):\n  c = c + b\nreturn c", 4, "For "),
        ("for x in p[n]:\n  pass\nreturn a", 3, "For "),
        ("a = b\nreturn a", 3, "a becomes another thing than it was"),
        ("c = a\nc = is_so\nreturn a", 4, "c becomes another thing than it was"),
        ("c, d = a, b\nc, d = d, c\nreturn c", 4, "an assignment that reads a name set with it"),
        ("if is_so:\n  c = a\nreturn c", 5, "Name 'c'"),
        ("if is_so:\n  return a", 3, "an end without return"),
        ("k, d, e = p\nreturn k", 3, "3 names for another number of fields"),
        ("register = a\nreturn register", 3, "register, a name that C has for something else"),
        ("p.first = a\nreturn a", 3, "Attribute 'p.first'"),
        ("c = lambda: a\nreturn a", 3, "Lambda 'lambda: a'"),
        ("c: float = a\nreturn c", 3, "AnnAssign 'c: float = a'"),
    ],
)  # fmt: skip
def test_the_rest_of_python_is_refused_with_its_place(body: str, line: int, why: str) -> None:
    with pytest.raises(UserError) as refused:
        statements(body)
    text = str(refused.value)
    assert text.startswith(f"f.py:{line}: {why}")
    assert text.endswith(": this does not become C")


@pytest.mark.parametrize(
    ("head", "why"),
    [
        ("def f(a: str) -> float:", "the type <class 'str'> is neither a number nor a record"),
        ("def f(default: float) -> float:", "default, a name that C has for something else"),
        ("def f(a) -> float:", "a parameter or the result without a type"),
        ("def f(*, a: float) -> float:", "a parameter or the result without a type"),
        ("def f(a: float) -> list[float]:", "the type list[float] is neither a number"),
    ],
)
def test_so_is_a_function_of_other_parameters(head: str, why: str) -> None:
    with pytest.raises(UserError) as refused:
        statements("return 0.0", head)
    assert str(refused.value).startswith(f"f.py:1: {why}")


def calls_itself(a: float) -> float:
    """Return for ever."""
    return calls_itself(a)


def test_a_function_that_calls_itself_is_refused() -> None:
    with pytest.raises(
        UserError, match=r"test_functions\.py:\d+: 'calls_itself\(a\)' calls itself"
    ):
        reached([calls_itself])


def same(a: float) -> float:
    """Return the same."""
    return a


def test_two_functions_of_one_name_are_refused() -> None:
    def makes() -> Callable[[float], float]:
        def same(a: float) -> float:
            """Return the same, elsewhere."""
            return a

        return same

    with pytest.raises(UserError, match=r"functions\.py:\d+: a second function same"):
        reached([same, makes()])
