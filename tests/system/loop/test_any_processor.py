"""The same results to the last bit, whichever instructions the libraries choose for a processor.

OpenBLAS and numpy look at the processor and take what is fastest there, which adds in different
orders and rounds differently. Made to behave as on the oldest, they must make no difference to what
they do on this one, nor (``--hypothesis-profile=explore``) made to behave as on others.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.compilation import compiled
from tests.support.runs.processor_results import results
from tests.support.suite.combinations import sampled

ROOT = Path(__file__).resolve().parents[3]
DISPATCHED = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
"""What numpy would use of this processor besides its baseline."""
AVX_512 = [name for name in DISPATCHED if name == "X86_V4" or "512" in name]
AVX_2 = [name for name in DISPATCHED if name in ("X86_V3", "AVX2")]
OLDEST = {
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENBLAS_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": " ".join(DISPATCHED),
}
HASWELL = {
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "2",
    "NPY_DISABLE_CPU_FEATURES": " ".join(AVX_512),
}
SKYLAKE_X = {"OPENBLAS_CORETYPE": "SkylakeX"}


def results_as(processor: Mapping[str, str]) -> dict[str, str]:
    if not processor:
        return results()
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.runs.processor_results"],
        cwd=ROOT,
        env={**os.environ, **processor},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, str] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def oldest() -> dict[str, str]:
    return results_as(OLDEST)


THIS = pytest.param({}, DISPATCHED, id="this one")


@pytest.mark.parametrize(
    ("other", "needed"),
    sampled(
        [THIS],
        [
            THIS,
            pytest.param(HASWELL, AVX_2, id="Haswell, which needs AVX2"),
            pytest.param(SKYLAKE_X, AVX_512, id="SkylakeX, which needs AVX-512"),
        ],
    ),
)
def test_designs_runs_and_studies_have_the_bits_of_the_oldest_processor(
    other: Mapping[str, str],
    needed: Sequence[str],
    oldest: Mapping[str, str],
    request: pytest.FixtureRequest,
) -> None:
    if not needed:
        pytest.skip(f"not on this processor: {request.node.callspec.id}")
    found = results_as(other)
    assert found.keys() == oldest.keys()
    assert [what for what in oldest if found[what] != oldest[what]] == []


@compiled
def _product_less(a: float, b: float, c: float) -> float:
    return a * b - c


def test_compiled_code_fuses_no_product_with_a_sum() -> None:
    """A fused one keeps the product's last digits, 2⁻⁵⁴ here, which a rounded one has lost."""
    a = 1.0 + 2.0**-27
    assert _product_less(a, a, 1.0 + 2.0**-26) == 0.0
