"""The generated law gives the bits of the Python that it is generated from."""

from itertools import product
from pathlib import Path

import pytest

from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.tools.generate_c.law_source import LAWS
from tests.support.in_c.law_in_c import (
    SANITIZED,
    Target,
    built,
    differing,
    drawn,
    hosts,
    in_c,
    in_python,
    m7,
    presets_in_c,
    written,
)
from tests.support.suite.combinations import sampled

TICKS = 3_000


PAIRS = [
    *((f"practical_{law}", "gcc") for law in LAWS),
    ("paper_pd_ddob", "gcc"),
    ("paper_pd_ddob", "clang"),
]


@pytest.mark.parametrize(
    ("preset", "compiler"), sampled(PAIRS, [*product(presets_in_c(), ("gcc", "clang"))])
)
def test_every_tick_has_the_same_bits(preset: str, compiler: str, tmp_path: Path) -> None:
    """The paper's has integrators, whose state at rest is a case, and follows the preview point."""
    settings = controller_preset(preset)
    driven = drawn(1, TICKS)
    expected, folder = in_python(settings, driven), written(settings, tmp_path)
    for target in (*hosts(compiler), *sampled((), (Target(compiler, SANITIZED),))):
        assert differing(expected, in_c(built(folder, target), driven)) == -1, target


@pytest.mark.parametrize("law", LAWS)
def test_a_cortex_m7_has_them_too(law: str, tmp_path: Path) -> None:
    settings = controller_preset(f"practical_{law}")
    target, driven = m7("-O2"), drawn(2, 1000)
    program = built(written(settings, tmp_path), target)
    assert differing(in_python(settings, driven), in_c(program, driven, target.runner)) == -1
