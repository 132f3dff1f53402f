"""Lines of generated C, kept within a width."""

import re
from collections.abc import Sequence

WIDTH = 100
_BREAKS = re.compile(r", | (?=(&&|\|\||[|?:+*/-]) )")


def joined_declarations(lines: Sequence[str]) -> list[str]:
    """Return declarations of numbers, one after the other, as one that fits the width."""
    found: list[str] = []
    for line in lines:
        begins, last = "const double ", found[-1] if found else ""
        both = f"{last[:-1]}, {line[len(begins) :]}"
        if line.startswith(begins) and last.startswith(begins) and len(both) <= WIDTH - 4:
            found[-1] = both
        else:
            found.append(line)
    return found


def wrapped_arguments(line: str) -> list[str]:
    """Return a line that ends with arguments, broken before and within these if it is too long."""
    if len(line) <= WIDTH - 11:
        return [line]
    head, _, rest = line.partition("(")
    lines = [f"{head}(", "   "]
    for argument in rest.replace(", ", ",\n").splitlines():
        if len(lines[-1]) + len(argument) > WIDTH - 11:
            lines.append("   ")
        lines[-1] += f" {argument}"
    return lines


def folded(text: str) -> str:
    """Break long lines before an operator, or after a comma."""
    lines = []
    for line in text.splitlines():
        indent = " " * (len(line) - len(line.lstrip()) + 4)
        rest = line
        while len(rest) > WIDTH:
            breaks = [it.end() for it in _BREAKS.finditer(rest, len(indent) + 1, WIDTH)]
            if not breaks:
                break
            lines.append(rest[: breaks[-1]].rstrip())
            rest = indent + rest[breaks[-1] :]
        lines.append(rest)
    return "\n".join(lines) + "\n"
