"""The index page: one self-contained HTML file, pictures inside, no script, nothing from elsewhere.

It is XML too, so that an XML parser can check it. Every text is escaped.
"""

from base64 import b64encode
from collections.abc import Callable, Sequence
from html import escape

from .result import Comparison, Verdict
from .written import Written

_MARKS = {
    Verdict.REPRODUCED: "good",
    Verdict.WITH_CORRECTION: "fair",
    Verdict.NOT_REPRODUCIBLE: "poor",
    Verdict.BEYOND: "more",
}

_MEANING = {
    Verdict.REPRODUCED: "what the paper prints gives what it says",
    Verdict.WITH_CORRECTION: "it does, once a misprint is mended or something every implementation "
    "needs is supplied; the correction is spelt out",
    Verdict.NOT_REPRODUCIBLE: "the text leaves out what would be needed, or what it prints gives "
    "something else",
    Verdict.BEYOND: "the paper has no such figure or table",
}

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
       max-width: 72rem; margin: 2rem auto; padding: 0 1.5rem; }
h1 { line-height: 1.2; } h2 { margin: 0 0 .3rem; font-size: 1.25rem; }
a { color: #0b5394; }
table { border-collapse: collapse; width: 100%; margin: .8rem 0; font-size: .92rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .6rem;
         border-bottom: 1px solid #ddd; }
th { border-bottom: 2px solid #999; }
section { margin-top: 2.5rem; padding-top: 1.2rem; border-top: 1px solid #bbb; }
img { max-width: 100%; height: auto; display: block; margin: .8rem 0 0; }
.caption, .data { color: #444; font-size: .92rem; margin: .2rem 0; }
.verdict { display: inline-block; padding: .05rem .55rem; border-radius: .8rem;
           border: 1px solid; font-size: .88rem; white-space: nowrap; }
.good { background: #e3f4e5; border-color: #2e7d32; }
.fair { background: #fdf3d8; border-color: #b58100; }
.poor { background: #fbe4e0; border-color: #b3402a; }
.more { background: #e5eefa; border-color: #2a5db0; }
.yes { color: #2e7d32; } .no { color: #b3402a; font-weight: 600; }
@media print { body { margin: 0; max-width: none; font-size: 11px; }
  section { break-before: page; border: 0; } img, tr { break-inside: avoid; } }
"""


def index_page(written: Sequence[Written], read_png: Callable[[str], bytes]) -> str:
    """Return the page.

    ``written``   in the order in which they appear
    ``read_png``  gives the picture of a stem
    """
    sections = "\n".join(_section(item, read_png) for item in written)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8" />
<meta name="viewport" content="width=device-width, initial-scale=1" />
<title>SAE 2018-01-1086, reproduced</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>SAE 2018-01-1086, reproduced</h1>
<p>Figures and tables of Wang and Guvenc, <i>Use of Robust DOB/CDOB Compensation to Improve
Autonomous Vehicle Path Following Performance in the Presence of Model Uncertainty, CAN Bus Delays
and External Disturbances</i>, computed by this project's own models and laws. Published is what
the paper prints; where it is a picture only, what its text says of it.</p>
{_meanings(written)}
{_summary(written)}
{sections}
</body>
</html>
"""


def heading(item: Written) -> str:
    """Return "Figure 8: title" from the key, unless the title says so itself."""
    kind, _, rest = item.key.partition("_")
    if item.title.startswith(("Figure", "Table")) or not rest[:1].isdigit():
        return item.title
    number, _, _ = rest.partition("_")
    beyond = "Beyond " if item.verdict is Verdict.BEYOND else ""
    return f"{beyond}{kind.capitalize()} {int(number)}: {item.title}"


def agreement(comparisons: Sequence[Comparison]) -> str:
    """Return how many of the comparisons that can agree do."""
    judged = [comparison.agrees for comparison in comparisons if comparison.agrees is not None]
    return f"{sum(judged)} of {len(judged)}" if judged else "-"


def _meanings(written: Sequence[Written]) -> str:
    rows = "\n".join(
        f"<tr><td>{_verdict(verdict)}</td><td>{escape(meaning)}</td>"
        f"<td>{sum(item.verdict is verdict for item in written)}</td></tr>"
        for verdict, meaning in _MEANING.items()
    )
    return _table(("Verdict", "Means", "Here"), rows)


def _summary(written: Sequence[Written]) -> str:
    rows = "\n".join(
        f'<tr><td><a href="#{escape(item.key)}">{escape(heading(item))}</a></td>'
        f"<td>{_verdict(item.verdict)}</td><td>{agreement(item.comparisons)}</td></tr>"
        for item in written
    )
    return _table(("Figure or table", "Verdict", "Comparisons that agree"), rows)


def _section(item: Written, read_png: Callable[[str], bytes]) -> str:
    pictures = "\n".join(_picture(name, item, read_png) for name in item.pictures)
    rows = "\n".join(_comparison(comparison) for comparison in item.comparisons)
    return f"""<section id="{escape(item.key)}">
<h2>{escape(heading(item))}</h2>
{_verdict(item.verdict)}
<p>{escape(item.why)}</p>
{pictures}
<p class="caption">{escape(item.caption)}</p>
{_table(("Quantity", "Published", "Reproduced", "Agrees"), rows)}
</section>"""


def _picture(name: str, item: Written, read_png: Callable[[str], bytes]) -> str:
    data = b64encode(read_png(name)).decode("ascii")
    text = escape(f"{heading(item)} ({name})")
    file = escape(f"{name}.csv")
    return (
        f'<img src="data:image/png;base64,{data}" alt="{text}" />\n'
        f'<p class="data">Data: <a href="{file}">{file}</a></p>'
    )


def _comparison(comparison: Comparison) -> str:
    mark = {True: "yes", False: "no", None: ""}[comparison.agrees]
    return (
        f"<tr><td>{escape(comparison.quantity)}</td><td>{_lines(comparison.published)}</td>"
        f'<td>{_lines(comparison.reproduced)}</td><td class="{mark}">{mark or "-"}</td></tr>'
    )


def _lines(text: str) -> str:
    """Return a text with each of its parts on its own line."""
    return "<br />".join(escape(part) for part in text.split("; ")) or "-"


def _verdict(verdict: Verdict) -> str:
    return f'<span class="verdict {_MARKS[verdict]}">{escape(verdict)}</span>'


def _table(headings: Sequence[str], rows: str) -> str:
    if not rows:
        return ""
    cells = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
    return f"<table>\n<thead><tr>{cells}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
