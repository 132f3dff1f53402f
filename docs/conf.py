"""Sphinx makes the site from this folder: ``make docs``."""

import os
import re
import sys
from importlib.metadata import version as version_of
from itertools import pairwise
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math.latex2mathml import tex2mathml

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))

from reference_pages import write_pages  # noqa: E402

project = "Steer-by-wire emulator"
version = release = version_of("steer-by-wire-emulator")
html_title = f"{project} {version}"
html_theme = "furo"
html_show_copyright = False
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "gallery/**/*.ipynb"]

myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
highlight_language = "text"

# A session in Python is copied without its prompts and without what it printed.
copybutton_prompt_text = r">>> |\.\.\. "
copybutton_prompt_is_regexp = True
copybutton_selector = "div.highlight-sh pre, div.highlight-pycon pre, div.highlight-toml pre"
copybutton_selector += ", div.highlight-python pre"

# Links to others' documentation: INTERSPHINX=1 make docs, with a network.
if os.environ.get("INTERSPHINX"):
    extensions.append("sphinx.ext.intersphinx")
    intersphinx_mapping = {
        "python": ("https://docs.python.org/3", None),
        "numpy": ("https://numpy.org/doc/stable", None),
        "can": ("https://python-can.readthedocs.io/en/stable", None),
    }

autodoc_member_order = "bysource"
autodoc_default_options = {"exclude-members": "model_config"}
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
# Types in signatures are not all documented; in the text every name must be.
nitpick_ignore_regex = [("py:.*", r".*")]


sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\w+\.py$",
    # It needs a bus, and is shown where its protocol is explained.
    "ignore_pattern": r"^foreign_\w+\.py$",
    # An example writes its pictures to files; a notebook also shows them.
    "last_notebook_cell": (
        "from pathlib import Path\n"
        "from IPython.display import Image, display\n"
        "\n"
        "for picture in sorted(Path('out/examples').glob('*.png')):\n"
        "    display(Image(picture))"
    ),
    "image_scrapers": ("gallery_pictures.take_pictures",),
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,
}
COLAB = "https://colab.research.google.com/github/{}/blob/gh-pages/notebooks/{}.ipynb"
IS_RELEASE = os.environ.get("GITHUB_REF_TYPE") == "tag"
"""Then the workflow puts the site on the branch gh-pages, where Binder and Colab find notebooks."""
if IS_RELEASE:
    wanted = f"steer-by-wire-emulator[tools]=={version}"
    (DOCS / "generated").mkdir(exist_ok=True)
    (DOCS / "generated" / "requirements.txt").write_text(f"{wanted}\n", encoding="utf-8")
    org, _, repo = os.environ["GITHUB_REPOSITORY"].partition("/")
    sphinx_gallery_conf |= {
        "first_notebook_cell": f'%pip install --quiet "{wanted}"',
        "binder": {
            "org": org,
            "repo": repo,
            "branch": "gh-pages",
            "binderhub_url": "https://mybinder.org",
            "dependencies": ["generated/requirements.txt"],
            "use_jupyter_lab": True,
        },
    }


def name_lists(_app: Any, what: str, _name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """Make of lines with a name and its meaning the definition list of reStructuredText."""
    written: list[str] = []
    inside = False
    for before, line in pairwise(["", *lines]):
        entry = re.match(r"(``[^`]+``(?:, ``[^`]+``)*) +(.*)", line)
        inside = bool(line.strip()) and (inside or (entry is not None and not before.strip()))
        if inside:
            written += [entry[1], f"    {entry[2]}"] if entry else [f"    {line.strip()}"]
        else:
            written.append(line)
    is_field = what == "attribute" and lines[0].startswith("Alias for field")
    lines[:] = [] if is_field else written


def without_fields(_app: Any, what: str, *_: Any) -> tuple[str, None] | None:
    """Leave out the signatures of classes: their fields follow one by one."""
    return ("", None) if what == "class" else None


def write_mathml(writer: Any, node: Any) -> None:
    """Write a formula in the browser's own language, which needs no script and no network."""
    writer.body.append(tex2mathml(node.astext(), as_block=node.tagname == "math_block"))
    raise SkipNode


MADE_OF = {
    "dbc/steer_by_wire.dbc": "generated/messages.md",
    "controller/settings.py": "generated/controller_settings.md",
    "plant_emulator/settings.py": "generated/plant_settings.md",
    "tools/design/specification.py": "generated/design_specification.md",
    "examples/README.md": "gallery/index.rst",
    **{
        f"examples/{file.name}": f"gallery/{file.stem}.rst"
        for file in DOCS.parent.glob("examples/*.py")
        if not file.name.startswith("foreign_")
    },
}
"""What GitHub shows in place of a page that is made with the site."""


def link_to_made_pages(_app: Any, docname: str, source: list[str]) -> None:
    """Let links to files of the repository lead to the pages that are made of them."""
    if docname.startswith(("gallery/", "generated/")):
        return
    for file, page in MADE_OF.items():
        link = rf"\]\((?:\.\./)+{re.escape(file)}(#[^)]*)?\)"
        source[0] = re.sub(link, lambda found, page=page: f"](/{page}{found[1] or ''})", source[0])


def link_to_colab(_app: Any, docname: str, source: list[str]) -> None:
    """Let a page of the gallery end with a link that opens its notebook."""
    if IS_RELEASE and docname.startswith("gallery/") and not docname.endswith("index"):
        address = COLAB.format(os.environ["GITHUB_REPOSITORY"], docname)
        source[0] += f"\n\n`Open this notebook in Colab <{address}>`__\n"


def setup(app: Any) -> None:
    """Write the generated pages before Sphinx looks for pages."""
    write_pages(DOCS / "generated")
    app.add_html_math_renderer("mathml", (write_mathml, None), (write_mathml, None))
    app.connect("source-read", link_to_made_pages)
    app.connect("source-read", link_to_colab)
    app.connect("autodoc-process-docstring", name_lists)
    app.connect("autodoc-process-signature", without_fields)
