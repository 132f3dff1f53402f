"""The page: one self-contained HTML file, pictures inside, no script, nothing from elsewhere.

It is XML too, so that an XML parser can check it. Every text is escaped.
"""

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
       max-width: 76rem; margin: 2rem auto; padding: 0 1.5rem; }
h1 { line-height: 1.2; } h2 { margin: 0 0 .3rem; font-size: 1.25rem; }
table { border-collapse: collapse; margin: .8rem 0; font-size: .9rem; }
th, td { text-align: left; vertical-align: top; padding: .25rem .5rem;
         border-bottom: 1px solid #ddd; }
th { border-bottom: 2px solid #999; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
section { margin-top: 2.2rem; padding-top: 1rem; border-top: 1px solid #bbb; }
img { max-width: 100%; height: auto; display: block; margin: .8rem 0 0; }
summary { cursor: pointer; color: #444; }
code { font-size: .85rem; overflow-wrap: anywhere; }
.caption { color: #444; font-size: .92rem; max-width: 62rem; }
@media print { body { margin: 0; max-width: none; font-size: 11px; }
  section { border: 0; } img, tr { break-inside: avoid; } }
"""


class Cell(NamedTuple):
    """A cell of a table: a number stands to the right, a command in its own type.

    ``folded``  what is shown only where the reader opens it, below the text
    """

    text: str
    kind: str = "text"
    folded: str = ""


class Table(NamedTuple):
    """A table; every row has as many cells as there are headings."""

    headings: Sequence[str]
    rows: Sequence[Sequence[Cell]]


class Picture(NamedTuple):
    """A PNG, with what it shows for those who do not see it."""

    png: bytes
    text: str


class Section(NamedTuple):
    """A heading, and below it, in this order, what there is."""

    title: str
    paragraphs: Sequence[str]
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()


def number(text: str) -> Cell:
    """Return a cell with a number."""
    return Cell(text, "number")


def page(title: str, sections: Sequence[Section]) -> str:
    """Return the page."""
    body = "\n".join(_section(section) for section in sections)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8" />
<meta name="viewport" content="width=device-width, initial-scale=1" />
<title>{escape(title)}</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>{escape(title)}</h1>
{body}
</body>
</html>
"""


def _section(section: Section) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>"]
    parts += [f"<p>{escape(text)}</p>" for text in section.paragraphs]
    parts += [_picture(picture) for picture in section.pictures]
    parts += [_table(table) for table in section.tables if table.rows]
    parts += [f'<p class="caption">{escape(text)}</p>' for text in section.notes]
    return "<section>\n" + "\n".join(parts) + "\n</section>"


def _picture(picture: Picture) -> str:
    data = b64encode(picture.png).decode("ascii")
    return f'<img src="data:image/png;base64,{data}" alt="{escape(picture.text)}" />'


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(heading)}</th>" for heading in table.headings)
    rows = "\n".join("<tr>" + "".join(_cell(cell) for cell in row) + "</tr>" for row in table.rows)
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"


def _cell(cell: Cell) -> str:
    text = escape(cell.text)
    if cell.folded:
        text += f"<details><summary>all of them</summary>{escape(cell.folded)}</details>"
    if cell.kind == "code":
        return f"<td><code>{text}</code></td>"
    return f'<td class="number">{text}</td>' if cell.kind == "number" else f"<td>{text}</td>"
