import tomllib
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, PositiveFloat, ValidationError, field_validator, model_validator

from steer_by_wire.runtime.settings import (
    Preset,
    Settings,
    SettingsError,
    load_settings,
    preset_names,
    read_preset,
)
from steer_by_wire.runtime.settings.toml_text import dump_toml


class Circle(Settings):
    kind: Literal["circle"] = "circle"
    radius_m: PositiveFloat


class Line(Settings):
    kind: Literal["line"] = "line"
    pieces: Annotated[int, Field(ge=1, le=5)] = 3


class Order(StrEnum):
    NEWEST = "newest"
    OLDEST = "oldest"


class Motor(Settings):
    speed_m_s: Annotated[float, Field(gt=0, le=60)]
    range_rad: tuple[float, float] = (-1.0, 1.0)

    @field_validator("range_rad")
    @classmethod
    def _rising(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[0] >= value[1]:
            raise ValueError("must rise")
        return value


class Rig(Settings):
    track: Annotated[Circle | Line, Field(discriminator="kind")] = Line()
    motor: Motor
    law: Literal["pd", "dob"] = "pd"
    order: Order = Order.NEWEST
    note: str = ""
    log: bool = False
    file: Path | None = None
    limit: PositiveFloat | None = None
    seed: Annotated[int, Field(ge=0)] = 1
    steps: tuple[tuple[float, float], ...] = ()
    stages: tuple[Line, ...] = ()
    gains: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _no_luck_needed(self) -> "Rig":
        if self.seed == 13:
            raise ValueError("seed 13 needs luck")
        return self


PRESET = Preset(
    "basic",
    """
limit = 1.5
[track]
kind = "circle"
radius_m = 50.0
[motor]
speed_m_s = 10.0
""",
)


def mistakes(*overrides: str) -> tuple[str, ...]:
    with pytest.raises(SettingsError) as caught:
        load_settings(Rig, PRESET, None, overrides)
    return caught.value.mistakes


def mistakes_in(file: Path) -> tuple[str, ...]:
    with pytest.raises(SettingsError) as caught:
        load_settings(Rig, None, file)
    return caught.value.mistakes


def test_later_layers_lie_on_top_key_by_key(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text("seed = 7\n[motor]\nrange_rad = [-2, 2]\n")
    rig = load_settings(Rig, PRESET, file, ["seed=8", "motor.speed_m_s=20"])
    assert rig == Rig(
        track=Circle(radius_m=50.0),
        motor=Motor(speed_m_s=20.0, range_rad=(-2.0, 2.0)),
        limit=1.5,
        seed=8,
    )


def test_a_table_of_another_kind_replaces_the_one_below_whatever_the_order_of_overrides() -> None:
    line = Line(pieces=2)
    assert load_settings(Rig, PRESET, None, ["track.kind=line", "track.pieces=2"]).track == line
    assert load_settings(Rig, PRESET, None, ["track.pieces=2", "track.kind=line"]).track == line
    assert load_settings(Rig, PRESET, None, ["track.kind=circle"]).track == Circle(radius_m=50.0)


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("note=word", "word"),
        ("note = two words ", "two words"),
        ('note="3"', "3"),
        ("note=a=b", "a=b"),
        ("note='x'\nseed=3", "'x'\nseed=3"),
    ],
)
def test_an_override_that_is_not_toml_is_a_string(text: str, note: str) -> None:
    assert load_settings(Rig, PRESET, None, [text]).note == note


@pytest.mark.parametrize("text", ["seed", "=3", "seed=", "motor.=3", ".seed=3", ""])
def test_an_override_of_another_form_is_refused(text: str) -> None:
    assert mistakes(text) == (f"command line: {text}: is not of the form table.key=value",)


def test_an_override_inside_a_value_is_refused() -> None:
    assert mistakes("seed=1", "seed.x=1") == (
        "command line: seed.x=1: seed is set to a value before",
    )


def test_a_mistake_names_source_key_value_and_range() -> None:
    assert mistakes("motor.speed_m_s=-3") == (
        "command line: motor.speed_m_s = -3 should be greater than 0"
        " (allowed: number above 0, up to 60)",
    )


@pytest.mark.parametrize(
    ("override", "mistake"),
    [
        ("law=xx", 'law = "xx" is not a known one (allowed: pd, dob)'),
        ("law=3", "law = 3 is not a known one (allowed: pd, dob)"),
        (
            "order=new",
            'order = "new" is not a known one (did you mean newest? allowed: newest, oldest)',
        ),
        ("log=1", "log = 1 should be a valid boolean (allowed: true or false)"),
        ("seed=1.5", "seed = 1.5 should be a valid integer (allowed: integer from 0)"),
        ("seed=true", "seed = true should be a valid integer (allowed: integer from 0)"),
        ("limit=inf", "limit = Infinity should be a finite number (allowed: number above 0)"),
        ("limit=nan", "limit = NaN should be a finite number (allowed: number above 0)"),
        ("limit='2'", 'limit = "2" should be a valid number (allowed: number above 0)'),
        ("steps=3", "steps = 3 should be a valid array (allowed: list)"),
        ("motor=3", "motor = 3 should be an object (allowed: table)"),
        ("track.radius_m=0", "track.radius_m = 0 should be greater than 0"),
        ("steps=[[1,2],[3]]", "steps[1][1] is missing (allowed: number)"),
        ("steps=[[1,2],[3,'x']]", 'steps[1][1] = "x" should be a valid number (allowed: number)'),
        ("stages=[{pieces=9}]", "stages[0].pieces = 9 should be less than or equal to 5"),
        ("gains.p=x", 'gains.p = "x" should be a valid number (allowed: number)'),
        ("track.kind=oval", 'track.kind = "oval" is not a known one (allowed: circle or line)'),
        ("motor.range_rad=[2,1]", "motor.range_rad = [2, 1]: must rise"),
        ("motor.sped_m_s=3", "motor.sped_m_s is not a known key (did you mean motor.speed_m_s?)"),
        ("speed_m_s=3", "speed_m_s is not a known key (did you mean motor.speed_m_s?)"),
        (
            "track={length=3,w=2}",
            "track.length, track.w are not known keys (known: kind, radius_m)",
        ),
        ("stages=[{x=1}]", "stages[0].x is not a known key (known: kind, pieces)"),
        ("lwa=pd", "lwa is not a known key (did you mean law?)"),
    ],
)
def test_every_mistake_is_one_line_that_names_the_key(override: str, mistake: str) -> None:
    (line,) = mistakes(override)
    assert line.startswith(f"command line: {mistake}")
    assert "\n" not in line


def test_a_rule_about_several_keys_names_all_their_sources() -> None:
    assert mistakes("seed=13") == ("preset basic, command line: seed 13 needs luck",)


def test_what_is_missing_names_the_file_and_what_it_may_be(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text("[track]\npieces = 3\n[motor]\n")
    assert mistakes_in(file) == (
        f"{file}: track.kind is missing (allowed: circle or line)",
        f"{file}: motor.speed_m_s is missing (allowed: number above 0, up to 60)",
    )


def test_each_mistake_names_its_own_source(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text("seed = -1\n")
    with pytest.raises(SettingsError) as caught:
        load_settings(Rig, Preset("odd", 'law = "x"\nmotor.speed_m_s = 1'), file, ["log=3"])
    assert [line.partition(":")[0] for line in caught.value.mistakes] == [
        "preset odd",
        "command line",
        str(file),
    ]


def test_many_mistakes_are_cut_short() -> None:
    lines = mistakes(f"steps={[['x', 'y']] * 1000}")
    assert len(lines) == 21
    assert lines[-1] == "and 1980 mistakes more"
    assert ", zz19, 10 more are not known keys (" in mistakes(*(f"zz{n}=1" for n in range(30)))[0]


def test_a_file_that_is_not_toml_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text("seed = 1\nlaw = \n")
    (line,) = mistakes_in(file)
    assert line.startswith(f"{file}:2: is not TOML: ")


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_bytes(b"seed = \xff")
    assert mistakes_in(file) == (f"{file}: is not UTF-8 text (byte 7)",)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    directory = tmp_path / "package_with_presets"
    directory.mkdir()
    (directory / "__init__.py").write_text("")
    (directory / "slow.toml").write_text("seed = 2\n")
    (directory / "fast.toml").write_text("seed = 3\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return directory.name


def test_presets_are_read_from_their_package(package: str) -> None:
    assert preset_names(package) == ["fast", "slow"]
    assert read_preset(package, "slow") == Preset("slow", "seed = 2\n")


def test_an_unknown_preset_names_the_nearest_or_all(package: str) -> None:
    with pytest.raises(SettingsError, match=r"preset 'slo': .* \(did you mean slow\?\)"):
        read_preset(package, "slo")
    with pytest.raises(SettingsError, match=r"preset 'x': .* \(known: fast, slow\)"):
        read_preset(package, "x")
    with pytest.raises(SettingsError, match=r"preset '\.\./slow': there is none"):
        read_preset(package, "../slow")


def test_settings_are_frozen_and_refuse_unknown_keys_from_python_too() -> None:
    with pytest.raises(ValidationError):
        Circle.model_validate({"radius_m": 1.0, "x": 1})
    with pytest.raises(SettingsError, match=r"^Circle\(\): radius_m = Infinity should be a finite"):
        Circle(radius_m=float("inf"))
    with pytest.raises(ValidationError):
        Circle(radius_m=1.0).radius_m = 2.0


positive = st.floats(min_value=5e-324, allow_infinity=False)
finite = st.floats(allow_nan=False, allow_infinity=False)
text = st.text(st.characters(exclude_categories=["Cs"]))  # text() encodes each that there is
lines = st.builds(Line, pieces=st.integers(1, 5))
rigs = st.builds(
    Rig,
    track=st.builds(Circle, radius_m=positive) | lines,
    motor=st.builds(
        Motor,
        speed_m_s=st.floats(min_value=5e-324, max_value=60.0),
        range_rad=st.tuples(finite, finite).filter(lambda pair: pair[0] < pair[1]),
    ),
    law=st.sampled_from(["pd", "dob"]),
    note=text,
    log=st.booleans(),
    file=st.none() | st.just(Path("a/b c.csv")),
    limit=st.none() | positive,
    seed=st.integers(min_value=14),
    steps=st.lists(st.tuples(finite, finite)).map(tuple),
    stages=st.lists(lines).map(tuple),
    gains=st.dictionaries(text, finite),
)


@given(rigs)
def test_dumped_settings_load_again_to_the_last_digit(rig: Rig) -> None:
    dumped = dump_toml(rig)
    again = load_settings(Rig, Preset("dumped", dumped))
    assert again == rig
    assert repr(again) == repr(rig)  # distinguishes 0.0 from -0.0
    assert dump_toml(again) == dumped


def test_a_dump_is_readable() -> None:
    rig = load_settings(Rig, PRESET, None, ["gains.p=1e-5", "stages=[{pieces=2}]", "log=true"])
    dumped = dump_toml(rig)
    assert dumped == (
        'law = "pd"\n'
        'order = "newest"\n'
        'note = ""\n'
        "log = true\n"
        "limit = 1.5\n"
        "seed = 1\n"
        "steps = []\n"
        'stages = [{kind = "line", pieces = 2}]\n'
        "\n[track]\n"
        'kind = "circle"\n'
        "radius_m = 50.0\n"
        "\n[motor]\n"
        "speed_m_s = 10.0\n"
        "range_rad = [-1.0, 1.0]\n"
        "\n[gains]\n"
        "p = 1e-05\n"
    )
    assert tomllib.loads(dumped)["gains"] == {"p": 1e-05}
