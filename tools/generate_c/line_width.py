"""Lines of generated C, kept within a width."""

import re

WIDTH = 100
_BREAKS = re.compile(r", | (?=(&&|\|\||[|?:+*/-]) )")


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
