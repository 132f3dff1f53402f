"""Writes ``with-vcan`` as one file that can be copied to any machine with Python 3.10 or newer.

The file is a Python zip archive (zipapp). User Mode Linux needs the modules as files, so that the
archive unpacks itself, once, into the user's cache.
"""

import zipfile
from io import BytesIO
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_SHEBANG = b"#!/usr/bin/env python3\n"
_BOOT = """import hashlib
import os
import sys
import tempfile
import zipfile

if sys.version_info < (3, 10):
    sys.exit("with-vcan: error: needs Python 3.10 or newer")
archive = os.path.dirname(os.path.abspath(__file__))
with open(archive, "rb") as file:
    digest = hashlib.sha256(file.read()).hexdigest()[:16]
cache = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
folder = os.path.join(cache, "with-vcan", digest)
if not os.path.isdir(folder):
    os.makedirs(os.path.dirname(folder), mode=0o700, exist_ok=True)
    unpacked = tempfile.mkdtemp(dir=os.path.dirname(folder))
    with zipfile.ZipFile(archive) as content:
        content.extractall(unpacked)
    try:
        os.rename(unpacked, folder)
    except OSError:  # another run was first
        pass
sys.dont_write_bytecode = True
sys.path[0] = folder
from with_vcan.__main__ import main

sys.exit(main())
"""


def write_single_file(path: Path) -> None:
    """Write the archive, executable; raises OSError."""
    content = BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        _add(archive, "__main__.py", _BOOT)
        for file in sorted((*_PACKAGE.glob("*.py"), _PACKAGE / "xstate.c")):
            _add(archive, f"with_vcan/{file.name}", file.read_text(encoding="utf-8"))
    path.write_bytes(_SHEBANG + content.getvalue())
    path.chmod(path.stat().st_mode | 0o111)


def _add(archive: zipfile.ZipFile, name: str, text: str) -> None:
    """Add a file without the time of day, so that the same sources give the same archive."""
    archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)
