"""The generated C gives the bits of the Python that it is generated from, and no mutant does."""

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.tools.generate_c import functions, records
from steer_by_wire.tools.generate_c.law_source import LAWS
from tests.support.in_c.law_in_c import built, differing, drawn, hosts, in_c, in_python, m7, written
from tests.support.suite.combinations import sampled

TICKS = 3_000


@pytest.mark.parametrize(
    ("preset", "compiler"),
    [
        *((f"practical_{law}", "gcc") for law in LAWS),
        ("paper_pd_ddob", "gcc"),
        ("paper_pd_ddob", "clang"),
    ],
)
def test_every_tick_has_the_same_bits(preset: str, compiler: str, tmp_path: Path) -> None:
    """The paper's has integrators, whose state at rest is a case of its own."""
    settings = controller_preset(preset)
    driven = drawn(1, TICKS)
    expected, folder = in_python(settings, driven), written(settings, tmp_path)
    for target in hosts(compiler):
        assert differing(expected, in_c(built(folder, target), driven)) == -1, target


@pytest.mark.parametrize("law", LAWS)
def test_a_cortex_m7_has_them_too(law: str, tmp_path: Path) -> None:
    target, settings, driven = m7("-O2"), controller_preset(f"practical_{law}"), drawn(2, 1000)
    program = built(written(settings, tmp_path), target)
    assert differing(in_python(settings, driven), in_c(program, driven, target.runner)) == -1


def no_parentheses(text: functions.Text, _binds: int) -> str:
    return text.text


def swapped(text: str) -> Callable[..., Any]:
    """A translation in which the operands of one operator have changed places."""
    original = functions.Function._found

    def found(self: functions.Function, node: ast.expr) -> functions.Text:
        it = original(self, node)
        if not (isinstance(node, ast.BinOp) and ast.unparse(node) == text):
            return it
        other = ast.BinOp(left=node.right, op=node.op, right=node.left)
        return original(self, ast.copy_location(other, node))

    return found


def regrouped(self: functions.Function, node: ast.expr) -> functions.Text:
    """A sum of three that begins with its last two."""
    match node:
        case ast.BinOp(left=ast.BinOp(left=one, op=first, right=two), op=ast.Add(), right=three):
            if isinstance(first, ast.Sub):
                two = ast.copy_location(ast.UnaryOp(op=ast.USub(), operand=two), node)
            later = ast.copy_location(ast.BinOp(left=two, op=ast.Add(), right=three), node)
            node = ast.copy_location(ast.BinOp(left=one, op=ast.Add(), right=later), node)
    return FOUND(self, node)


def not_carried(text: str) -> Callable[..., Any]:
    """A translation that leaves out one assignment to a name that has a value."""
    original = functions.Function._set

    def left_out(self: functions.Function, target: ast.expr, value: functions.Text) -> list[str]:
        lines = original(self, target, value)
        return [line for line in lines if not line.startswith(f"{text} = ")]

    return left_out


def with_15_digits(value: float) -> str:
    return f"{float(value):.15e}"


FOUND = functions.Function._found
OPERATORS = functions._OPERATORS
MUTANTS: dict[str, tuple[Any, str, Any]] = {
    "no parentheses": (functions.Text, "within", no_parentheses),
    "a difference swapped": (
        functions.Function, "_found", swapped("demand_rad - disturbance_rad"),
    ),
    "another difference swapped": (functions.Function, "_found", swapped("b2 * u - a2 * y")),
    "another order of sums": (functions.Function, "_found", regrouped),
    "an observer's filter not carried": (functions.Function, "_set", not_carried("x_error")),
    "its other filter not carried": (functions.Function, "_set", not_carried("x_command")),
    "the PD not carried": (functions.Function, "_set", not_carried("x_pd")),
    "the disturbance not carried": (functions.Function, "_set", not_carried("disturbance_rad")),
    "the lower limit not set": (functions.Function, "_set", not_carried("low_rad")),
    "15 digits": (records, "hexadecimal", with_15_digits),
    "greater for less": (functions, "_OPERATORS", {**OPERATORS, ast.Lt: (">", 2)}),
}  # fmt: skip


@pytest.mark.parametrize("name", sampled([*MUTANTS][::3], [*MUTANTS]))
def test_a_mutant_of_the_generator_is_caught(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, driven = hosts()[0], drawn(1, 2000)
    settings = controller_preset("practical_pd_ddob")
    monkeypatch.setattr(*MUTANTS[name])
    program = built(written(settings, tmp_path), target)
    assert differing(in_python(settings, driven), in_c(program, driven)) >= 0
