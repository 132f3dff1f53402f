"""All designs, last sentences of runs and starved messages, of which the suite judges a sample."""

from pathlib import Path
from typing import Any

import pytest

from tests.soak.babbling_node import GAPS
from tests.soak.test_virtual_soak import (
    test_what_is_starved_does_not_hold_up_what_has_a_higher_priority as holds_up_nothing,
)
from tests.support.same_process import same_process as same_process
from tests.tools.design import test_designed_presets as presets
from tests.tools.design import test_other_cars as cars
from tests.tools.run.test_final_sentence import test_the_last_sentence_is_true as is_true

CITY_CAR = {
    "vehicle": "m = 950 J = 1150 cf = 85e3 cr = 105e3 lf = 0.95 lr = 1.25 ls = 2.0 V = 2.8",
    "speed_m_s": (2.0, 3.6),
    "virtual_mass_kg": (850.0, 1500.0),
}
SEDAN = {
    "vehicle": "m = 1600 J = 2700 cf = 120e3 cr = 150e3 lf = 1.25 lr = 1.5 ls = 2.0 V = 5.6",
    "speed_m_s": (4.2, 7.0),
    "virtual_mass_kg": (1400.0, 2600.0),
}


@pytest.mark.parametrize(
    ("family", "law"),
    [
        ("practical", "pd"),
        ("practical_half_second", "pd_ddob"),
        ("practical_long_delay", "pd_ddob"),
        ("highway", "pd_ddob"),
    ],
)
def test_a_designed_preset_says_what_is_measured_anew(family: str, law: str) -> None:
    presets.test_a_designed_preset_says_what_is_measured_anew(family, law)


def test_the_predictor_of_the_highway_says_what_is_measured_anew() -> None:
    presets.test_a_designed_predictor_says_what_is_measured_anew(
        "highway_predictor", "highway_vehicle", "highway"
    )


@pytest.mark.usefixtures("same_process")
@pytest.mark.parametrize(
    ("car", "radius_m"), [(CITY_CAR, 15.0), (SEDAN, 30.0)], ids=["a small city car", "a sedan"]
)
def test_a_car_that_is_designed_is_held_in_a_simulator_written_apart(
    car: dict[str, Any], radius_m: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cars.test_a_car_that_is_designed_is_held_in_a_simulator_written_apart(
        car, radius_m, tmp_path, capsys
    )


@pytest.mark.parametrize("number", range(40))
def test_the_last_sentence_of_a_drawn_run_is_true(number: int) -> None:
    is_true(number)


@pytest.mark.parametrize("can_id", [gap[0] for gap in GAPS])
def test_what_is_starved_does_not_hold_up_what_has_a_higher_priority(can_id: int) -> None:
    holds_up_nothing(can_id)
