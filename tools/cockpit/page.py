"""The page's files: served one by one, or put together into one file that needs no server.

The modules name each other ``cockpit/NAME.js``; an import map says where they are. For one file
that is a data URL each, so that nothing has to be built.
"""

import base64
import json
import re
from collections.abc import Mapping
from functools import cache
from importlib import resources

_INDEX = "index.html"
_TYPES = {
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".LICENSE": "text/plain",
}
_IMPORT_MAP = '<script type="importmap"></script>'
_LINK = re.compile(r'<link rel="stylesheet" href="([\w./]+)">')
_SCRIPT = re.compile(r'<script src="([\w./]+)"></script>')
_ICON = re.compile(r'href="(icon\.svg)"')


@cache
def page_files() -> Mapping[str, tuple[str, str]]:
    """Return text and type of every file that a page may load, by its name."""
    folder = resources.files(__package__).joinpath("page")
    found = {}
    for prefix, place in (("", folder), ("vendor/", folder.joinpath("vendor"))):
        for file in place.iterdir():
            kind = _TYPES.get("." + file.name.rpartition(".")[2])
            if kind is not None:
                found[prefix + file.name] = (file.read_text(encoding="utf-8"), kind)
    return found


def served_page(nonce: str) -> str:
    """Return the page that loads its files from a server; its scripts carry ``nonce``."""
    imports = {name: f"./{name.partition('/')[2]}" for name in _modules()}
    return _with_imports(imports).replace("<script", f'<script nonce="{nonce}"')


def single_page(block: bytes, title: str) -> str:
    """Return one file that plays the replay in ``block`` without a server."""
    files = page_files()
    imports = {
        name: _data_url(files[name.partition("/")[2]][0], "text/javascript") for name in _modules()
    }
    text = _with_imports(imports)
    text = _LINK.sub(lambda link: f"<style>\n{files[link[1]][0]}</style>", text)
    text = _SCRIPT.sub(lambda script: f"<script>\n{files[script[1]][0]}</script>", text)
    text = _ICON.sub(lambda icon: f'href="{_data_url(files[icon[1]][0], "image/svg+xml")}"', text)
    data = base64.b64encode(block).decode("ascii")
    text = text.replace("<title>Cockpit</title>", f"<title>{title}</title>")
    return text.replace(
        "</body>", f'<script type="application/gzip" id="replay">{data}</script>\n</body>'
    )


def _modules() -> list[str]:
    return [f"cockpit/{name}" for name in page_files() if name.endswith(".js") and "/" not in name]


def _with_imports(imports: Mapping[str, str]) -> str:
    index = resources.files(__package__).joinpath("page", _INDEX)
    text = index.read_text(encoding="utf-8")
    table = json.dumps({"imports": imports})
    return text.replace(_IMPORT_MAP, f'<script type="importmap">{table}</script>')


def _data_url(text: str, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(text.encode()).decode('ascii')}"
