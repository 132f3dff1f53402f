"""The site: every page is reached, every link leads somewhere; diagrams are those drawn."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
BUILD = """
import gc, sys
from sphinx.cmd.build import main
gc.disable()  # what it makes, it keeps
sys.exit(main(sys.argv[1:]))
"""


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Pages that no other names, names that are not defined, and dead links are warnings."""
    options = ("-b", "dummy", "-q", "-n", "-W", "--keep-going")
    without = ("-D", "plot_gallery=0", "-D", "smartquotes=0")
    result = subprocess.run(
        [sys.executable, "-c", BUILD, *options, *without, DOCS, tmp_path],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_the_diagrams_are_those_of_their_program(tmp_path: Path) -> None:
    subprocess.run([sys.executable, DOCS / "diagrams.py", tmp_path], check=True)
    drawn = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert len(drawn) > 3
    assert drawn == {name: (DOCS / "images" / name).read_bytes() for name in drawn}
