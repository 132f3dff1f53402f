"""The generated feedback law gives the bits of the Python that it is generated from."""

import subprocess
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from steer_by_wire.hand_wheel.feedback_laws import (
    FEEDBACK_AT_REST,
    FEEDBACK_LAWS,
    FeedbackInput,
    resist,
)
from steer_by_wire.hand_wheel.settings import FeedbackSettings, HandWheelSettings
from steer_by_wire.tools.generate_c.__main__ import main
from tests.support.in_c.law_in_c import EXTREMES, STRICT, Floats, hosts

DRIVE = """
#include <stdio.h>
#include "feedback_law.h"

int main(void)
{
    struct feedback_state law;
    struct feedback_input input;

    feedback_start(&law);
    while (fread(&input, sizeof input, 1, stdin) == 1) {
        const double torque_n_m = feedback_step(&law, &input);
        fwrite(&torque_n_m, sizeof torque_n_m, 1, stdout);
    }
    return 0;
}
"""
LAWS = get_args(FeedbackSettings.model_fields["law"].annotation)


def drawn(seed: int) -> Floats:
    random = np.random.default_rng(seed)
    rows = np.cumsum(random.normal(0.0, 0.02, (3000, 5)), axis=0) * [1.0, 5.0, 1e3, 0.1, 5.0]
    rows[random.random(3000) < 0.2, 1] = 0.0
    rows[-50:, 2] = random.choice(EXTREMES, 50)
    return np.ascontiguousarray(rows)


@pytest.mark.parametrize("law", LAWS)
def test_every_cycle_has_the_same_bits(law: str, tmp_path: Path) -> None:
    table = {"law": law, "damping_n_m_s": 0.3, "friction_n_m": 0.1, "passive_n_m_s_max": 2.0}
    words = [f"feedback.{key}={value}" for key, value in table.items()]
    folder = tmp_path / "law"
    asked = [f"--set={word}" for word in words]
    assert main(["--feedback", "--preset", "still", *asked, "--out", str(folder)]) == 0
    (folder / "drive.c").write_text(DRIVE)
    p = HandWheelSettings.model_validate({"feedback": table}).feedback_params
    state, expected, driven = FEEDBACK_AT_REST, [], drawn(1)
    for row in driven.tolist():
        state, against = FEEDBACK_LAWS[law].step(p, state, FeedbackInput(*row))
        state, torque = resist(p, state, against, row[1])
        expected.append(torque)
    for target in hosts():
        build = [target.compiler, *STRICT, *target.options, "-o", "drive", "drive.c"]
        subprocess.run([*build, "feedback_law.c"], cwd=folder, check=True)
        run = subprocess.run([folder / "drive"], input=driven.tobytes(), check=True,
                             stdout=subprocess.PIPE)  # fmt: skip
        np.testing.assert_array_equal(np.frombuffer(run.stdout), expected)
