"""Sources of the Python functions that become C: their text, what they call, their records."""

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from steer_by_wire.runtime.exit_status import UserError

from .records import Records, names_of_tuples

_ROOT = Path(__file__).resolve().parents[2]


class Source(NamedTuple):
    """A Python function, the tree of its text, and where that stands."""

    function: Any
    tree: ast.FunctionDef
    file: str
    line: int

    def refuse(self, node: ast.AST, why: str) -> NoReturn:
        """Raise UserError that names the place."""
        line = self.line + getattr(node, "lineno", 1) - 1
        raise UserError(f"{self.file}:{line}: {why}: this does not become C")

    def meant(self, node: ast.AST) -> Any:
        """Return what a name in the text stands for, None for a local one."""
        match node:
            case ast.Name(id=name):
                return self.function.__globals__.get(name)
            case ast.Attribute(value=ast.Name(id="math"), attr=name):
                return getattr(math, name, None)
            case ast.Attribute(value=ast.Name(id=name), attr=member):
                return getattr(self.function.__globals__.get(name), member, None)
        return None

    def called(self) -> Iterator[tuple[ast.AST, Any]]:
        """Yield what the text calls, by its name or by a row of a constant table."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Call):
                yield node, self.meant(node.func)
            elif isinstance(node, ast.For) and isinstance(node.iter, ast.Subscript):
                table = self.meant(node.iter.value)
                for rows in table.values() if isinstance(table, Mapping) else ():
                    yield from ((node, part) for row in rows for part in row)


def source_of(function: Callable[..., Any]) -> Source:
    """Return the source of a function."""
    if not inspect.isfunction(function):
        raise UserError(f"{function!r} is no plain function: this does not become C")
    lines, line = inspect.getsourcelines(function)
    (tree,) = ast.parse(textwrap.dedent("".join(lines))).body
    path = Path(inspect.getsourcefile(function) or "?").resolve()
    file = str(path.relative_to(_ROOT)) if path.is_relative_to(_ROOT) else path.name
    source = Source(function, tree, file, line)  # type: ignore[arg-type]
    if not isinstance(tree, ast.FunctionDef) or tree.decorator_list:
        source.refuse(tree, "no function with a name, or one with a decorator")
    return source


def hints_of(source: Source) -> Mapping[str, Any]:
    """Return the types of a function's parameters and of ``return``."""
    names = (*(it.arg for it in source.tree.args.args), "return")
    hints: Mapping[str, Any] = inspect.get_annotations(source.function, eval_str=True)
    if [*hints] != [*names]:
        source.refuse(source.tree, "a parameter or the result without a type, or not positional")
    return hints


def reached(roots: Sequence[Callable[..., Any]]) -> list[Source]:
    """Return the roots and all functions that they call, a called one before its callers."""
    found: dict[Any, Source] = {}

    def visit(source: Source, above: tuple[Any, ...]) -> None:
        for node, called in source.called():
            if called in above:
                source.refuse(node, f"{ast.unparse(node)!r:.60} calls itself")
            if inspect.isfunction(called) and called not in found:
                visit(source_of(called), (*above, called))
        found[source.function] = source

    for source in map(source_of, roots):
        visit(source, (source.function,))
    names: set[str] = set()
    for source in found.values():
        if source.tree.name in names:
            source.refuse(source.tree, f"a second function {source.tree.name}")
        names.add(source.tree.name)
    return [*found.values()]


def records_of(sources: Sequence[Source]) -> Records:
    """Return the structs of functions, with the fields that the functions read or give by name."""
    aliases = names_of_tuples(source.function.__globals__ for source in sources)
    taken_apart: dict[object, tuple[str, ...]] = {}
    read: set[str] = set()
    for source in sources:
        for hint, names in _taken_apart(source, hints_of(source)):
            taken_apart.setdefault(hint, names)
        for node in ast.walk(source.tree):
            match node:
                case ast.Attribute(attr=str(name)) | ast.keyword(arg=str(name)):
                    read.add(name)
    return Records(aliases, taken_apart, frozenset(read))


def _taken_apart(
    source: Source, hints: Mapping[str, Any]
) -> Iterator[tuple[object, tuple[str, ...]]]:
    """Yield type and names where a function takes a parameter apart into plain names."""
    for node in ast.walk(source.tree):
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=parts)], value=ast.Name(id=name)):
                names = tuple(part.id for part in parts if isinstance(part, ast.Name))
                if name in hints and len(names) == len(parts):
                    yield hints[name], names
