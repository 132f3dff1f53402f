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


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("--preset practical_predictor",
         "law = 'predictor' does not become C: pd, pd_dob, pd_cdob, pd_ddob, pid do"),
        ("--preset practical_pd --set feed_forward.gain=1",
         "[feed_forward] does not become C: leave it out"),
        ("--preset practical_pid --set pid.heading_gain_rad_rad=1",
         "pid.heading_gain_rad_rad does not become C: leave it out"),
        ("--preset practical_pd --set supervision.stops_if_implausible=true",
         "supervision.stops_if_implausible does not become C: leave it out"),
    ],
)  # fmt: skip
def test_what_stays_in_python_is_refused_in_one_line(
    words: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words.split(), "--out", str(tmp_path / "law")]) == 2
    assert capsys.readouterr().err == f"steer-by-wire generate-c: error: {why}\n"
    assert not (tmp_path / "law").exists()


def test_a_file_in_place_of_the_folder_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "law").write_text("a file")
    words = ["--preset", "practical_pd", "--out", str(tmp_path / "law")]
    assert main(words) == 2
    why = f"--out {tmp_path / 'law'} is a file: give the name of a folder"
    assert capsys.readouterr().err == f"steer-by-wire generate-c: error: {why}\n"


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
