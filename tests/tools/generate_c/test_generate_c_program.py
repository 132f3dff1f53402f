"""``steer-by-wire generate-c``: its files, and its refusals in one line."""

from pathlib import Path

import pytest

from steer_by_wire.tools.generate_c.__main__ import GENERATED, main


def test_it_writes_a_folder_and_says_what_is_generated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "law"
    assert main(["--preset", "practical_pd_dob", "--out", str(folder)]) == 0
    *names, rest = capsys.readouterr().out.splitlines()
    assert names == [str(folder / it) for it in GENERATED]
    assert all(Path(name).is_file() for name in names)
    assert rest == f"and {len([*folder.iterdir()]) - 4} files around these: make -C {folder}"
    source = (folder / "steering_law.c").read_text(encoding="utf-8")
    assert "Law pd_dob at 100 Hz, generated from preset practical_pd_dob: do not edit." in source
    texts = [source, *(it.read_text(encoding="utf-8") for it in folder.glob("*node*"))]
    assert max(len(line) for text in texts for line in text.splitlines()) <= 100


def test_preset_and_file_are_named(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("rate_hz = 50.0\n")
    assert main([str(file), "--preset", "paper_pd", "--out", str(tmp_path)]) == 0
    title, *_ = (tmp_path / "steering_law.h").read_text(encoding="utf-8").splitlines()
    said = "generated from preset paper_pd and mine.toml: do not edit."
    assert title == f"/* Law pd at 50 Hz, {said}"


def test_another_law_is_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path), "--preset"]
    assert [main([*words, "practical_pd"]) for _ in range(2)] == [0, 0]
    kept = (tmp_path / "steering_law.c").read_bytes()
    assert main([*words, "practical_pid"]) == 2
    assert "has another run, whose steering_law.c differs" in capsys.readouterr().err
    assert (tmp_path / "steering_law.c").read_bytes() == kept


def test_a_file_that_was_edited_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--preset", "practical_pd", "--out", str(tmp_path)]
    assert main(words) == main(words) == 0
    (tmp_path / "on_can.c").write_bytes(b"mine\xff")  # of no encoding
    assert main(words) == 2
    assert f"--out {tmp_path} has another run, whose on_can.c differs" in capsys.readouterr().err
    assert (tmp_path / "on_can.c").read_bytes() == b"mine\xff"
