"""The site: every page is reached and every link leads somewhere; what the course shows is true."""

import doctest
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
LESSONS = sorted((DOCS / "learn").glob("[0-9]_*.md"))


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Pages that no other names, names that are not defined, and dead links are warnings."""
    command = ("-m", "sphinx", "-b", "dummy", "-q", "-n", "-W", "--keep-going")
    result = subprocess.run(
        [sys.executable, *command, "-D", "plot_gallery=0", DOCS, tmp_path],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda path: path.stem)
def test_what_a_lesson_shows_is_printed(lesson: Path) -> None:
    text = lesson.read_text(encoding="utf-8").replace("```", "")
    examples = doctest.DocTestParser().get_doctest(text, {}, lesson.stem, str(lesson), 0)
    assert examples.examples
    result = doctest.DocTestRunner().run(examples)
    assert result.failed == 0


def test_the_words_are_spelt_as_in_the_dictionary() -> None:
    pages = [*DOCS.rglob("*.md"), ROOT / "README.md", ROOT / "CHANGELOG.md"]
    result = subprocess.run(
        [sys.executable, "-m", "codespell_lib", *pages], capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stdout) == (0, "")


def test_the_diagrams_are_those_of_their_program(tmp_path: Path) -> None:
    subprocess.run([sys.executable, DOCS / "diagrams.py", tmp_path], check=True)
    drawn = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert len(drawn) > 3
    assert drawn == {name: (DOCS / "images" / name).read_bytes() for name in drawn}
