"""The page: one self-contained HTML file, with its pictures, no script and no external content.

It is XML too, so that an XML parser can check it. Every text is escaped.
"""

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

_STYLE = """
:root { --page: #fff; --shade: #0005; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: var(--page);
       max-width: 76rem; margin: 2rem auto; padding: 0 1.5rem; }
h1 { line-height: 1.2; } h2 { margin: 0 0 .3rem; font-size: 1.25rem; }
table { border-collapse: collapse; margin: .8rem 0; font-size: .9rem; }
th, td { text-align: left; vertical-align: top; padding: .25rem .5rem;
         border-bottom: 1px solid #ddd; }
th { border-bottom: 2px solid #999; }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th.number { white-space: normal; }
section { margin-top: 2.2rem; padding-top: 1rem; border-top: 1px solid #bbb; }
img { max-width: 100%; height: auto; display: block; margin: .8rem 0 0; }
summary { cursor: pointer; color: #444; }
code { font-size: .85rem; overflow-wrap: anywhere; }
a { color: #0b5394; }
.good, .fair, .poor { padding: .05rem .5rem; border: 1px solid; border-radius: .7rem;
                             font-size: .88rem; white-space: nowrap; }
.good { background: #e3f4e5; border-color: #2e7d32; }
.fair { background: #fdf3d8; border-color: #b58100; }
.poor { background: #fbe4e0; border-color: #b3402a; }
.caption { color: #444; font-size: .92rem; max-width: 62rem; }
.table { overflow-x: auto;  /* a shadow at the edge behind which there is more */
  background: linear-gradient(to right, var(--page) 40%, transparent) 0 / 2.5rem 100% local,
    linear-gradient(to left, var(--page) 40%, transparent) 100% / 2.5rem 100% local,
    linear-gradient(to right, var(--shade), transparent) 0 / .9rem 100%,
    linear-gradient(to left, var(--shade), transparent) 100% / .9rem 100%;
  background-repeat: no-repeat; }
.verdict { font-size: 1.1rem; }
nav { columns: 16rem; font-size: .92rem; } nav a { display: inline-block; }
@media (max-width: 40rem) { body { padding: 0 .8rem; margin: 1rem auto; }
  .good, .fair, .poor { white-space: normal; display: inline-block; }
  .picture { overflow-x: auto; } .picture img { max-width: none; width: 42rem; }
  .picture::after { content: "scroll \\2192"; position: sticky; left: 0; opacity: .7; } }
@media (prefers-color-scheme: dark) {
  :root { --page: #16181a; --shade: #fff5; }
  body { color: #e4e4e4; }
  a { color: #8ab8e8; } summary, .caption { color: #b4b4b4; }
  th, td, section { border-color: #444; }
  img { filter: brightness(.88); border-radius: .4rem; }
  .good, .fair, .poor { color: #1a1a1a; }
}
@media print { body { margin: 0; max-width: none; font-size: 11px; }
  section { border: 0; } img, tr { break-inside: avoid; } }
"""

_MARKS = ("good", "fair", "poor")


class Cell(NamedTuple):
    """A cell of a table, or a paragraph that is not plain text.

    ``kind``    "text", "number", "code", or a coloured mark: "good", "fair" or "poor"
    ``folded``  shown only if the reader opens it, below the text
    ``link``    a file next to the page, or "#" and the key of a section
    """

    text: str
    kind: str = "text"
    folded: str = ""
    link: str = ""


class Table(NamedTuple):
    """A table; every row has as many cells as there are headings, if there are any."""

    headings: Sequence[str]
    rows: Sequence[Sequence[Cell]]


class Picture(NamedTuple):
    """A PNG, and its text alternative."""

    png: bytes
    text: str


class Section(NamedTuple):
    """A heading, then the other fields in this order if present; links lead to its ``key``."""

    title: str
    paragraphs: Sequence[str | Cell] = ()
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()
    key: str = ""


def number(text: str) -> Cell:
    """Return a cell with a number."""
    return Cell(text, "number")


def page(title: str, sections: Sequence[Section], verdict: str | Cell = "") -> str:
    """Return the page: the verdict, a list of the sections, and these."""
    keyed = [each._replace(key=each.key or f"s{at}") for at, each in enumerate(sections, 1)]
    links = [_inline(Cell(each.title, link=f"#{each.key}")) for each in keyed]
    head = [f'<p class="verdict">{_inline(verdict)}</p>'] if verdict else []
    if len(links) > 2:
        head.append(f"<nav>{'<br />'.join(links)}</nav>")
    body = "\n".join([*head, *map(_section, keyed)])
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
    parts += [f"<p>{_inline(text)}</p>" for text in section.paragraphs]
    parts += [_picture(picture) for picture in section.pictures]
    parts += [_table(table) for table in section.tables if table.rows]
    parts += [f'<p class="caption">{escape(text)}</p>' for text in section.notes]
    return f'<section id="{escape(section.key)}">\n' + "\n".join(parts) + "\n</section>"


def _picture(picture: Picture) -> str:
    data = b64encode(picture.png).decode("ascii")
    image = f'<img alt="{escape(picture.text)}" src="data:image/png;base64,{data}" />'
    return f'<div class="picture" tabindex="0">{image}</div>'  # keys scroll what has the focus


def _table(table: Table) -> str:
    heads = "".join(
        f"<th{_column(cell)}>{escape(heading)}</th>"
        for heading, cell in zip(table.headings, table.rows[0], strict=False)
    )
    head = f"<thead><tr>{heads}</tr></thead>\n" if heads else ""
    rows = "\n".join(
        "<tr>" + "".join(f"<td{_column(cell)}>{_inline(cell)}</td>" for cell in row) + "</tr>"
        for row in table.rows
    )
    return f'<div class="table"><table>\n{head}<tbody>\n{rows}\n</tbody>\n</table></div>'


def _column(cell: Cell) -> str:
    return ' class="number"' if cell.kind == "number" else ""


def _inline(content: str | Cell) -> str:
    cell = Cell(content) if isinstance(content, str) else content
    text = escape(cell.text).replace("\n", "<br />")
    if cell.link:
        text = f'<a href="{escape(cell.link)}">{text}</a>'
    if cell.folded:
        text += f"<details><summary>all of them</summary>{escape(cell.folded)}</details>"
    if cell.kind == "code":
        return f"<code>{text}</code>"
    return f'<span class="{cell.kind}">{text}</span>' if cell.kind in _MARKS else text
