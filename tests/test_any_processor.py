"""The same results to the last bit, whichever instructions the libraries choose for a processor.

OpenBLAS and numpy look at the processor and take what is fastest there, which adds in different
orders and rounds differently. Told to behave as on others, they have to make no difference.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

from tools.batch.compilation import compiled

ROOT = Path(__file__).resolve().parent.parent
DISPATCHED = [name for name in __cpu_dispatch__ if __cpu_features__[name]]
"""What numpy would use of this processor besides its baseline."""
OLDEST = {
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENBLAS_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": " ".join(DISPATCHED),
}
OTHERS = {
    "Haswell": {  # AVX2 and FMA
        "OPENBLAS_CORETYPE": "Haswell",
        "OPENBLAS_NUM_THREADS": "2",
        "NPY_DISABLE_CPU_FEATURES": " ".join(
            name for name in DISPATCHED if name != "X86_V3" and not name.startswith(("AVX2", "FMA"))
        ),
    },
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},  # AVX-512, and all that numpy has
}
NEEDED = {"Haswell": "AVX2", "SkylakeX": "AVX512F"}


def results_as(processor: Mapping[str, str]) -> dict[str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "tests.processor_results"],
        cwd=ROOT,
        env={**os.environ, **processor},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    results: dict[str, str] = json.loads(done.stdout)
    return results


@pytest.fixture(scope="module")
def oldest() -> dict[str, str]:
    return results_as(OLDEST)


@pytest.mark.parametrize("name", OTHERS)
def test_designs_runs_studies_and_searches_have_the_bits_of_the_oldest_processor(
    name: str, oldest: Mapping[str, str]
) -> None:
    if not __cpu_features__[NEEDED[name]]:
        pytest.skip(f"needs a processor with {NEEDED[name]}, for the {name} kernels of OpenBLAS")
    found = results_as(OTHERS[name])
    assert found.keys() == oldest.keys()
    assert [what for what in oldest if found[what] != oldest[what]] == []


@compiled
def _product_less(a: float, b: float, c: float) -> float:
    return a * b - c


def test_compiled_code_fuses_no_product_with_a_sum() -> None:
    """A fused one keeps the product's last digits, 2⁻⁵⁴ here, which a rounded one has lost."""
    a = 1.0 + 2.0**-27
    assert _product_less(a, a, 1.0 + 2.0**-26) == 0.0
