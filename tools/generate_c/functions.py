"""One pure step function of Python as one function of C99.

The subset: ``float``, ``int`` of up to 64 bits, ``bool``, members of an IntEnum, records, None in
place of a number, local names, + - * / // % and the minus, ``and``, ``or``, ``not``, comparisons,
``a if condition else b``, ``isfinite``, ``abs``, ``min`` and ``max`` of two, ``float`` of an int,
calls of functions in the subset, ``new_record``, ``_replace``, ``if``, ``while``, ``return``, and
``for`` over the rows of a constant table, which is written out. Sums and products keep their order
and parentheses: a compiler that contracts nothing (``-ffp-contract=off``) gives the same bits.

Everything else is refused with its file and line: closures, an attribute that is set, an ``int`` in
place of a ``float``, a division by what has not been compared with 0. Fields of the parameters,
``p``, are divided by as they are: their settings exclude 0. ``if ...: raise`` is left out: it
depends on parameters alone, which the generator has tried.

Records are passed as pointers to const and returned by value. A name of a record is a pointer to
one that never changes, so no step changes what it was given.
"""

import ast
import inspect
import math
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple, NoReturn, TypeGuard

from .helpers import HELPERS
from .line_width import WIDTH
from .records import Kind, Record, Records, UntranslatableError, declared, hexadecimal, member_name
from .sources import Source, hints_of, source_of

_OPERATORS: Mapping[type, tuple[str, int]] = {
    ast.Add: ("+", 4), ast.Sub: ("-", 4), ast.Mult: ("*", 5), ast.Div: ("/", 5),
    ast.Lt: ("<", 3), ast.LtE: ("<=", 3), ast.Gt: (">", 3), ast.GtE: (">=", 3),
    ast.Eq: ("==", 3), ast.NotEq: ("!=", 3), ast.Is: ("==", 3), ast.IsNot: ("!=", 3),
}  # fmt: skip
_CHOICE, _LOGIC, _COMPARISON, _SIGN, _ATOM = 1, 2, 3, 6, 7
_INTEGER_DIVISIONS = {ast.FloorDiv: "floor_div", ast.Mod: "floor_mod"}
_INT32_MAX = 2**31 - 1
_TAKEN = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum",
    "extern", "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict",
    "return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union",
    "unsigned", "void", "volatile", "while", "bool", "true", "false", *HELPERS,
))  # fmt: skip
"""Names that C, or the rest of the generated file, has for something else."""


class Text(NamedTuple):
    """An expression of C, how strongly its outermost operator binds, and what it gives."""

    text: str
    binds: int
    kind: Kind
    is_pointer: bool = False
    is_kept: bool = True
    """Whether a pointer to it stays valid."""

    @property
    def address(self) -> str:
        """The pointer to a record."""
        return self.text if self.is_pointer else f"&{self.text}"

    def within(self, binds: int) -> str:
        """Return the text as an operand, in parentheses if it binds less."""
        return self.text if self.binds >= binds else f"({self.text})"


class Function:
    """Translates one function.

    ``records``  the structs, to which it adds

    ``parameters``  name and kind of each; ``result``  the kind of what it returns
    """

    def __init__(self, source: Source, records: Records) -> None:
        self._source, self._records = source, records
        *parameters, returned = hints_of(source).items()
        self.parameters = [(name, self._kind(source.tree, hint)) for name, hint in parameters]
        self._scope: dict[str, Text] = {}
        self._results = 0
        self._is_within_if = False
        self.name = source.function.__name__
        nodes = [*ast.walk(source.tree)]
        stored = [it for it in nodes if isinstance(it, ast.Name) and isinstance(it.ctx, ast.Store)]
        self._times_set = Counter(it.id for it in stored)
        named = [(name, source.tree) for name in (self.name, *dict(self.parameters))]
        for name, node in (*named, *((it.id, it) for it in stored)):
            if name in _TAKEN or name.startswith("result"):
                source.refuse(node, f"{name}, a name that C has for something else")
        self._not_zero = {
            name: line
            for it in nodes
            for name, line in _left_at_zero(it)
            if self._times_set[name] <= 1
        }
        self._constants: dict[str, Any] = {}
        """What the names of a row of a constant table stand for."""
        self.result = self._kind(source.tree, returned[1], f"{self.name}_result")

    def prototype(self, storage: str = "") -> str:
        """Return the function's head, without a semicolon."""
        parameters = [
            f"const {declared(kind)} *{name}" if isinstance(kind, Record) else f"{kind} {name}"
            for name, kind in self.parameters
        ]
        return f"{storage}{declared(self.result)} {self.name}({', '.join(parameters)})"

    def definition(self, storage: str = "") -> str:
        """Return the comment and the whole function; ``storage`` is ``static `` or nothing."""
        for name, kind in self.parameters:
            self._scope[name] = Text(name, _ATOM, kind, is_pointer=isinstance(kind, Record))
        said, *statements = self._source.tree.body
        if not (isinstance(said, ast.Expr) and isinstance(said.value, ast.Constant)):
            self._source.refuse(said, "a function without a docstring")
        if not isinstance(statements[-1], ast.Return):
            self._source.refuse(statements[-1], "an end without return")
        lines = [f"(void){name};" for name, _ in self.parameters if name.startswith("_")]
        lines += [line for statement in statements for line in self._statement(statement)]
        doc = f"{ast.get_docstring(self._source.tree)}\n\n(in {self._source.file})"
        comment = "\n".join(f" * {line}".rstrip() for line in doc.replace("*/", "").splitlines())
        body = textwrap.indent("\n".join(lines), "    ")
        return f"/*{comment[2:]} */\n{self.prototype(storage)}\n{{\n{body}\n}}\n"

    def _kind(self, node: ast.AST, hint: object, name: str = "") -> Kind:
        try:
            return self._records.kind_of(hint, name)
        except UntranslatableError as error:
            self._source.refuse(node, str(error))

    def _refuse(self, node: ast.AST, why: str = "") -> NoReturn:
        self._source.refuse(node, why or f"{type(node).__name__} {ast.unparse(node)!r:.60}")

    # Statements

    def _statement(self, node: ast.stmt) -> list[str]:
        match node:
            case ast.Return(value=ast.expr() as value):
                return [f"return {self._valued(value, self.result)};"]
            case ast.Assign(targets=[target], value=value):
                return self._assign(target, value)
            case ast.If(test=test, body=[ast.Raise()], orelse=[]):
                condition = self._expression(test, "bool").text
                return [f"/* {condition}: no parameters of this file lead here. */"]
            case ast.If(test=test, body=body, orelse=otherwise):
                return self._if("if", test, body, otherwise)
            case ast.While(test=test, body=body, orelse=[]):
                return self._if("while", test, body, [])
            case ast.For(target=ast.Tuple(elts=names), iter=ast.Subscript() as rows, body=body):
                return self._written_out(names, rows, body)
        return self._refuse(node)

    def _written_out(
        self, names: Sequence[ast.expr], rows: ast.Subscript, body: list[ast.stmt]
    ) -> list[str]:
        """Return a loop over the rows that a constant table has for a key, one after the other."""
        table, key = self._meant(rows.value), self._expression(rows.slice)
        if not isinstance(table, Mapping):
            self._refuse(rows.value, f"{ast.unparse(rows.value)}, no constant table")
        lines = []
        for one, its_rows in table.items():
            lines.append(f"if ({key.within(_COMPARISON + 1)} == {self._member(one)}) {{")
            for row in its_rows:
                self._constants = dict(zip(map(ast.unparse, names), row, strict=True))
                lines += [f"    {line}" for it in body for line in self._statement(it)]
            lines.append("}")
        self._constants = {}
        return lines

    def _meant(self, node: ast.AST) -> Any:
        """Return what a name that is not local stands for."""
        name = ast.unparse(node)
        return self._constants[name] if name in self._constants else self._source.meant(node)

    def _member(self, member: IntEnum) -> str:
        self._records.kind_of(type(member))
        return member_name(member)

    def _if(
        self, word: str, test: ast.expr, body: list[ast.stmt], otherwise: list[ast.stmt]
    ) -> list[str]:
        known, outside, self._is_within_if = {*self._scope}, self._is_within_if, True
        lines = [f"{word} ({self._expression(test, 'bool').text}) {{"]
        for begin, statements in (("", body), ("} else {", otherwise)):
            if statements:
                lines += [begin] if begin else []
                within = [line for it in statements for line in self._statement(it)]
                lines += [f"    {line}" for line in within]
            self._scope = {name: it for name, it in self._scope.items() if name in known}
        self._is_within_if = outside
        return [*lines, "}"]

    def _assign(self, target: ast.expr, value: ast.expr) -> list[str]:
        match target, value:
            case ast.Name(), _:
                return self._set(target, self._expression(value))
            case ast.Tuple(elts=targets), ast.Tuple(elts=values) if len(targets) == len(values):
                self._refuse_exchange(targets, values)
                pairs = zip(targets, values, strict=True)
                return [line for one, other in pairs for line in self._assign(one, other)]
            case ast.Tuple(), ast.Call():
                result = self._expression(value)
                self._results += 1
                name = "result" if self._results == 1 else f"result_{self._results}"
                line = f"const {declared(result.kind)} {name} = {result.text};"
                return [line, *self._apart(target, Text(name, _ATOM, result.kind))]
            case ast.Tuple(), _:
                return self._apart(target, self._expression(value))
        return self._refuse(target)

    def _refuse_exchange(self, targets: Sequence[ast.expr], values: Sequence[ast.expr]) -> None:
        """In Python all values come first; in C one assignment follows the other."""
        before: set[str] = set()
        for target, value in zip(targets, values, strict=True):
            if before & {it.id for it in ast.walk(value) if isinstance(it, ast.Name)}:
                self._refuse(value, "an assignment that reads a name set with it")
            before |= {it.id for it in ast.walk(target) if isinstance(it, ast.Name)}

    def _apart(self, target: ast.Tuple, record: Text) -> list[str]:
        """Take a record apart into names."""
        kind = record.kind
        if not isinstance(kind, Record) or len(kind.fields) != len(target.elts):
            self._refuse(target, f"{len(target.elts)} names for another number of fields")
        lines = []
        for one, (name, _) in zip(target.elts, kind.fields, strict=True):
            part = self._field(target, record, name)
            lines += self._apart(one, part) if isinstance(one, ast.Tuple) else self._set(one, part)
        return lines

    def _set(self, target: ast.expr, value: Text) -> list[str]:
        """Declare a name, or set it again."""
        if not isinstance(target, ast.Name):
            self._refuse(target)
        name, known = target.id, self._scope.get(target.id)
        is_record = isinstance(value.kind, Record)
        is_pointer = is_record and value.is_kept
        given = value.address if is_pointer else value.text
        if known is not None:
            is_other = (known.kind, known.is_pointer) != (value.kind, is_pointer)
            if is_other or name in dict(self.parameters) or (is_record and self._is_within_if):
                self._refuse(target, f"{name} becomes another thing than it was")
            return [f"{name} = {given};"]
        self._scope[name] = Text(name, _ATOM, value.kind, is_pointer)
        const = "" if self._times_set[name] > 1 else "const "
        if is_pointer:
            return [f"const {declared(value.kind)} *{const}{name} = {given};"]
        return [f"{const}{declared(value.kind)} {name} = {given};"]

    # Expressions

    def _expression(self, node: ast.expr, wanted: Kind | None = None) -> Text:
        found = self._found(node)
        if wanted is not None and found.kind != wanted:
            self._refuse(node, f"{ast.unparse(node)!r:.60} is no {declared(wanted)}")
        return found

    def _found(self, node: ast.expr) -> Text:
        match node:
            case ast.Name(id=name) if name in self._scope:
                return self._scope[name]
            case ast.Name() | ast.Attribute() if _is_number(value := self._meant(node)):
                return self._number(value)
            case ast.Constant(value=value) if _is_number(value):
                return self._number(value)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self._expression(operand)
                if inner.kind not in ("double", "int64_t"):
                    self._refuse(operand, f"{ast.unparse(operand)!r:.60} is no number")
                return Text(f"-{inner.within(_ATOM)}", _SIGN, inner.kind)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return Text(f"!{self._expression(operand, 'bool').within(_ATOM)}", _SIGN, "bool")
            case ast.BoolOp(op=op, values=values):
                sign = " && " if isinstance(op, ast.And) else " || "
                parts = [self._expression(it, "bool").within(_LOGIC + 1) for it in values]
                return Text(sign.join(parts), _LOGIC, "bool")
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _INTEGER_DIVISIONS:
                self._refuse_zero(node, right)
                parts = [self._expression(it, "int64_t").text for it in (left, right)]
                text = f"{_INTEGER_DIVISIONS[type(op)]}({', '.join(parts)})"
                return Text(text, _ATOM, "int64_t")
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                kind = self._expression(left).kind
                if isinstance(op, ast.Div):
                    self._refuse_zero(node, right)
                    kind = "double"
                sign, binds = _OPERATORS[type(op)]
                wanted = kind if kind == "int64_t" else "double"
                before = self._expression(left, wanted).within(binds)
                after = self._expression(right, wanted).within(binds + 1)
                return Text(f"{before} {sign} {after}", binds, wanted)
            case ast.Compare(left=left, ops=ops, comparators=others):
                pairs = zip([left, *others], ops, others, strict=False)
                parts = [self._compared(node, *pair) for pair in pairs]
                return Text(" && ".join(parts), _COMPARISON if len(parts) == 1 else _LOGIC, "bool")
            case ast.IfExp(test=test, body=body, orelse=otherwise):
                condition = self._expression(test, "bool").within(_LOGIC)
                one = self._expression(body)
                other = self._expression(otherwise, one.kind)
                if isinstance(one.kind, Record):
                    self._refuse(node, "a choice between records")
                text = f"{condition} ? {one.within(_LOGIC)} : {other.within(_CHOICE)}"
                return Text(text, _CHOICE, one.kind)
            case ast.Attribute(value=value, attr=name):
                return self._field(node, self._expression(value), name)
            case ast.Subscript(value=value, slice=ast.Constant(value=int(index))):
                record = self._expression(value)
                if isinstance(record.kind, Record) and 0 <= index < len(record.kind.fields):
                    return self._field(node, record, record.kind.fields[index][0])
            case ast.Call(func=ast.Attribute(value=value, attr="_replace"), args=[]):
                return self._replaced(node, self._expression(value))
            case ast.Call(func=called, args=arguments, keywords=[]):
                return self._call(node, self._meant(called), arguments)
            case ast.Call(func=called, args=[], keywords=named) if self._is_record(called):
                kind = self._meant(called)
                return self._call(node, kind, self._in_order(node, kind, named))
        return self._refuse(node)

    def _number(self, value: float) -> Text:
        if isinstance(value, bool):
            return Text("true" if value else "false", _ATOM, "bool")
        if isinstance(value, IntEnum):
            return Text(self._member(value), _ATOM, "int64_t")
        if isinstance(value, int):
            text = str(value) if abs(value) <= _INT32_MAX else f"INT64_C({value})"
            return Text(text, _ATOM if value >= 0 else _SIGN, "int64_t")
        return Text(hexadecimal(value), _ATOM, "double")

    def _compared(self, node: ast.Compare, left: ast.expr, op: ast.cmpop, right: ast.expr) -> str:
        if type(op) not in _OPERATORS:
            self._refuse(node)
        one, sign = self._expression(left), _OPERATORS[type(op)][0]
        if isinstance(right, ast.Constant) and right.value is None:
            if one.kind == "double":
                return f"{'' if sign == '==' else '!'}is_nan({one.text})"
            return f"{one.within(_COMPARISON + 1)} {sign} INT64_MIN"
        other = self._expression(right, one.kind)
        if isinstance(one.kind, Record):
            return self._compared_records(node, one, other, sign)
        return f"{one.within(_COMPARISON + 1)} {sign} {other.within(_COMPARISON + 1)}"

    def _compared_records(self, node: ast.Compare, one: Text, other: Text, sign: str) -> str:
        """Return the comparison of all fields of two records of numbers."""
        names = dict(one.kind.fields) if isinstance(one.kind, Record) else {}
        pairs = [(self._field(node, one, it), self._field(node, other, it)) for it in names]
        if any(isinstance(left.kind, Record) for left, _ in pairs):
            self._refuse(node)
        joined = " && " if sign == "==" else " || "
        return f"({joined.join(f'{left.text} {sign} {right.text}' for left, right in pairs)})"

    def _replaced(self, node: ast.Call, record: Text) -> Text:
        """Return a copy of a record with other values in some fields."""
        given = {it.arg: it.value for it in node.keywords}
        fields = dict(record.kind.fields) if isinstance(record.kind, Record) else {}
        if not fields or [*given] != [it for it in fields if it in given]:
            self._refuse(node)
        texts = [
            self._valued(given[name], kind)
            if name in given
            else self._field(node, record, name).text
            for name, kind in fields.items()
        ]
        return Text(f"({declared(record.kind)}){_braces(texts)}", _ATOM, record.kind, is_kept=False)

    def _refuse_zero(self, node: ast.expr, divisor: ast.expr) -> None:
        """Refuse a division that Python could refuse."""
        name, value = ast.unparse(divisor), self._value_of(divisor)
        is_compared = name in self._not_zero and self._not_zero[name] < divisor.lineno
        if not (is_compared or name.startswith("p.") or value):
            self._refuse(node, f"a division by {name}, which may be 0")

    def _value_of(self, node: ast.expr) -> float:
        """Return the value of a constant, and the least one of ``max`` with one; else 0."""
        match node:
            case ast.Call(func=ast.Name(id="max"), args=[_, least]):
                return max(self._value_of(least), 0.0)
        value = node.value if isinstance(node, ast.Constant) else self._meant(node)
        return value if _is_number(value) and ast.unparse(node) not in self._scope else 0.0

    def _field(self, node: ast.AST, record: Text, name: str) -> Text:
        fields = dict(record.kind.fields) if isinstance(record.kind, Record) else {}
        if name not in fields:
            self._refuse(node, f"there is no field {name}")
        arrow = "->" if record.is_pointer else "."
        return Text(f"{record.text}{arrow}{name}", _ATOM, fields[name], is_kept=record.is_kept)

    def _call(self, node: ast.Call, called: object, arguments: list[ast.expr]) -> Text:
        if called is math.isfinite and len(arguments) == 1:
            inner = self._expression(arguments[0], "double").text
            return Text(f"is_finite({inner})", _ATOM, "bool")
        match node.func, arguments:
            case ast.Name(id="float"), [argument]:
                inner = self._expression(argument, "int64_t").within(_ATOM)
                return Text(f"(double){inner}", _SIGN, "double")
            case ast.Name(id="abs"), [argument]:
                return Text(
                    f"magnitude({self._expression(argument, 'double').text})", _ATOM, "double"
                )
            case ast.Name(id="min" | "max" as name), [one, two]:
                kind = self._expression(one).kind
                texts = [self._expression(it, kind).text for it in (one, two)]
                helper = f"{name}_int" if kind == "int64_t" else name
                return Text(f"{helper}({', '.join(texts)})", _ATOM, kind)
            case ast.Name(id="new_record"), [kind, ast.Tuple(elts=values)]:
                return self._call(node, self._meant(kind), values)
        if isinstance(called, type) and issubclass(called, tuple):
            kind = self._kind(node, called)
            literal = f"({declared(kind)}){self._literal(node, arguments, kind)}"
            return Text(literal, _ATOM, kind, is_kept=False)
        if not inspect.isfunction(called):
            self._refuse(node)
        other = Function(source_of(called), self._records)
        if len(other.parameters) != len(arguments):
            self._refuse(node, "another number of arguments")
        passed = []
        for argument, (_, kind) in zip(arguments, other.parameters, strict=True):
            value = self._expression(argument, kind)
            if isinstance(value.kind, Record) and not value.is_kept:
                self._refuse(argument, "a record without a name as an argument")
            passed.append(value.address if isinstance(value.kind, Record) else value.text)
        call = f"{other.name}({', '.join(passed)})"
        return Text(call, _ATOM, other.result, is_kept=False)

    def _is_record(self, called: ast.expr) -> bool:
        kind = self._meant(called)
        return isinstance(kind, type) and issubclass(kind, tuple)

    def _in_order(
        self, node: ast.Call, called: object, named: Sequence[ast.keyword]
    ) -> list[ast.expr]:
        """Return the values of a record that is made by the names of all its fields."""
        kind = self._kind(node, called)
        names = [name for name, _ in kind.fields] if isinstance(kind, Record) else []
        if [it.arg for it in named] != names:
            self._refuse(node, "names that are not those of a record's fields, in their order")
        return [it.value for it in named]

    def _valued(self, node: ast.expr, kind: Kind) -> str:
        """Return an expression of a kind, a tuple as a literal of its record."""
        if isinstance(node, ast.Tuple):
            return f"({declared(kind)}){self._literal(node, node.elts, kind)}"
        if isinstance(node, ast.Constant) and node.value is None:
            return "INT64_MIN" if kind == "int64_t" else "none()"
        value = self._expression(node, kind)
        return f"*{value.text}" if value.is_pointer else value.text

    def _literal(self, node: ast.expr, parts: Sequence[ast.expr], kind: Kind) -> str:
        if not isinstance(kind, Record) or len(parts) != len(kind.fields):
            self._refuse(node, f"{ast.unparse(node)!r:.60} is no {declared(kind)}")
        texts = []
        for part, (_, its_kind) in zip(parts, kind.fields, strict=True):
            if isinstance(part, ast.Tuple):
                texts.append(self._literal(part, part.elts, its_kind))
            else:
                texts.append(self._valued(part, its_kind))
        return _braces(texts)


def _is_number(value: object) -> TypeGuard[float]:
    """Whether a constant becomes a number of C."""
    return isinstance(value, int) or (isinstance(value, float) and math.isfinite(value))


def _braces(texts: Sequence[str]) -> str:
    """Return the values of a record as C writes them, on one line where they fit."""
    line = f"{{{', '.join(texts)}}}"
    if len(line) <= WIDTH - 40:
        return line
    return f"{{\n{textwrap.indent(''.join(f'{it},{chr(10)}' for it in texts), '    ')}}}"


def _left_at_zero(node: ast.AST) -> Sequence[tuple[str, int]]:
    """Return the names with which ``if name == 0.0 or ...: ... return`` leaves, and their line."""
    match node:
        case ast.If(test=ast.BoolOp(op=ast.Or(), values=tests), body=[*_, ast.Return()]):
            pass
        case ast.If(test=test, body=[*_, ast.Return()]):
            tests = [test]
        case _:
            return []
    parts = [ast.unparse(test).rpartition(" == ") for test in tests]
    return [(name, node.test.lineno) for name, _, zero in parts if zero in ("0.0", "0")]
