"""Mutants of a module: each differs from it in one comparison, bound, operator or constant.

What is mutated, one place at a time, anywhere below a function, a class or the module itself:

    a < b        every other comparison
    3, 0.5       one more and one less; a thousandth more and less (0.0: a millionth)
    a + b        −, and so on in pairs; −a without its sign; ``not a`` without its "not"
    a and b      or
    min, max     the other; ``abs(a)`` is a; ``math.inf`` is small

Annotations, texts and defaults of no number are left alone. Changes are of the syntax tree, so a
mutant is compiled and run in this process, in milliseconds.
"""

import ast
import importlib.util
import inspect
from collections.abc import Callable, Collection, Iterator
from itertools import islice
from pathlib import Path
from types import FunctionType, ModuleType
from typing import NamedTuple

import pytest

from tests.support.suite.combinations import ALL, sampled

SAMPLE = 8
_COMPARISONS: tuple[type[ast.cmpop], ...] = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)
_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
}
_FUNCTIONS = {"min": "max", "max": "min"}


class Mutant(NamedTuple):
    """A changed module: where and what was changed, and its source's tree."""

    place: str
    change: str
    tree: ast.Module

    def __str__(self) -> str:
        return f"{self.place}: {self.change}"


def mutants(module: ModuleType) -> Iterator[Mutant]:
    """Yield every mutant of ``module``, in the order of its lines.

    All have the same tree, which is as each says until the next is asked for.
    """
    source = _source_file(module).read_text(encoding="utf-8")
    tree, lines = ast.parse(source), ["", *source.splitlines()]
    for node in list(_mutable(tree)):
        kind, fields, before = node.__class__, node.__dict__, ast.unparse(node)
        place = lines[getattr(node, "lineno", 0)].strip()
        for replacement in list(_replacements(node)):
            # In place: the nodes are of one class, or take the other's class and fields.
            node.__class__ = replacement.__class__
            node.__dict__ = {**fields, **replacement.__dict__}
            after = ast.unparse(ast.fix_missing_locations(node))
            yield Mutant(place, f"{before}  ->  {after}", tree)
            node.__class__, node.__dict__ = kind, fields


def unchanged(module: ModuleType) -> ModuleType:
    """Return a copy of ``module``, loaded as its mutants are."""
    return _load(module, ast.parse(_source_file(module).read_text(encoding="utf-8")))


def _load(module: ModuleType, tree: ast.Module) -> ModuleType:
    """Return ``tree`` as a module in the place of ``module``; what its code raises, it raises."""
    code = compile(tree, str(_source_file(module)), "exec")
    spec = importlib.util.spec_from_loader(module.__name__, loader=None)
    assert spec is not None
    mutated = importlib.util.module_from_spec(spec)
    exec(code, mutated.__dict__)  # noqa: S102
    return mutated


def assert_noticed(
    module: ModuleType, check: Callable[[ModuleType], object], equivalent: Collection[str] = ()
) -> None:
    """Raise what ``check`` does of ``module``, or if it raises nothing of one of its mutants.

    ``equivalent``  changes without an effect: ``before  ->  after``, or the line, ``: `` and that

    A push tries one mutant of SAMPLE; ``--hypothesis-profile=explore`` all, and each equivalent.
    """
    check(unchanged(module))
    tried, alive = 0, []
    for mutant in islice(mutants(module), None, None, 1 if ALL else SAMPLE):
        tried += 1
        if not _is_noticed(module, mutant, check):
            alive.append(mutant)
    assert tried >= sampled(3, 18), f"only {tried} mutants"  # so many has the smallest module
    allowed = {text for mutant in alive for text in (str(mutant), mutant.change)} & {*equivalent}
    unnoticed = [str(one) for one in alive if not {str(one), one.change} & allowed]
    assert not unnoticed, unnoticed
    assert not ALL or allowed == {*equivalent}


def _is_noticed(module: ModuleType, mutant: Mutant, check: Callable[[ModuleType], object]) -> bool:
    try:
        check(_load(module, mutant.tree))
    except (Exception, pytest.fail.Exception):  # the second where nothing is raised
        return True
    return False


def run_tests(test_module: ModuleType, mutant: ModuleType, *helpers: ModuleType) -> None:
    """Run the tests of ``test_module``, without those of mutants, with a mutant as its ``tested``.

    ``helpers``  modules beside it that the tests use, with the same ``tested``
    """
    modules = (test_module, *helpers)
    originals = [vars(module)["tested"] for module in modules]
    for module in modules:
        vars(module)["tested"] = mutant
    try:
        for name, function in inspect.getmembers(test_module, inspect.isfunction):
            if name.startswith("test_") and not name.endswith("_mutant"):
                for arguments in _runs(function):
                    function(*arguments)
    finally:
        for module, original in zip(modules, originals, strict=True):
            vars(module)["tested"] = original


def _runs(function: FunctionType) -> list[tuple[object, ...]]:
    """Return the arguments of each run of a test, which may have one list of parameters."""
    for mark in getattr(function, "pytestmark", ()):
        return [value if isinstance(value, tuple) else (value,) for value in mark.args[1]]
    return [()]


def _source_file(module: ModuleType) -> Path:
    assert module.__file__ is not None
    return Path(module.__file__)


def _mutable(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the nodes to change, outside annotations."""
    annotations: set[int] = set()
    for node in ast.walk(tree):
        for field in ("annotation", "returns"):
            inside = getattr(node, field, None)
            if isinstance(inside, ast.AST):
                annotations.update(id(child) for child in ast.walk(inside))
    for node in ast.walk(tree):
        if id(node) not in annotations and next(iter(_replacements(node)), None) is not None:
            yield node


def _replacements(node: ast.AST) -> Iterator[ast.AST]:
    match node:
        case ast.Compare(left=left, ops=[operator], comparators=[right]):
            for other in _COMPARISONS:
                if type(operator) in _COMPARISONS and type(operator) is not other:
                    yield ast.Compare(left=left, ops=[other()], comparators=[right])
        case ast.Constant(value=bool() | str() | None):
            return
        case ast.Constant(value=int() as number):
            yield from (ast.Constant(value=number + 1), ast.Constant(value=number - 1))
        case ast.Constant(value=float() as number):
            step = 1e-3 * number if number else 1e-6
            yield from (ast.Constant(value=number + step), ast.Constant(value=number - step))
        case ast.BinOp(left=left, op=binary, right=right) if type(binary) in _OPERATORS:
            yield ast.BinOp(left=left, op=_OPERATORS[type(binary)](), right=right)
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield operand
        case ast.BoolOp(op=boolean, values=values):
            yield ast.BoolOp(
                op=ast.Or() if isinstance(boolean, ast.And) else ast.And(), values=values
            )
        case ast.Call(func=ast.Name(id=name), args=arguments) if name in _FUNCTIONS:
            function = ast.Name(id=_FUNCTIONS[name], ctx=ast.Load())
            yield ast.Call(func=function, args=arguments, keywords=[])
        case ast.Call(func=ast.Name(id="abs"), args=[argument]):
            yield argument
        case ast.Attribute(value=ast.Name(id="math"), attr="inf"):
            yield ast.Constant(value=1e-3)
