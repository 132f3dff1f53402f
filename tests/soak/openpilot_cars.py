"""Read and drive our cars by opendbc for a minute each, and exchange a million frames with it.

Its safety code, compiled with gcc, accepts every frame of the car, and of its controller every one
but those of the first 20 ms, before it has seen the car.

    python -m tests.soak.openpilot_cars

Needs opendbc (the extra ``dev``). Takes about five minutes; the first thing that fails ends it.
"""

import sys
import tempfile
from itertools import product
from pathlib import Path

from steer_by_wire.closed_loop.reports.terminal import plain_console
from tests.system import test_openpilot_cars as cars

SEEN_NS = 20_000_000


def the_safety_code_accepts_the_traffic(name: str, folder: Path) -> str:
    """Return how many frames were accepted and refused."""
    _, follower = cars.driven(name, folder, is_watched=True)
    code = follower.safety
    assert code.may_control
    assert not code.invalid_s
    assert not code.refused_ns["car"]
    assert max(code.refused_ns["controller"], default=0) <= SEEN_NS
    refused = len(code.refused_ns["controller"])
    car, controller = code.accepted["car"], code.accepted["controller"]
    return f"{car} of the car and {controller} of the controller accepted, {refused} refused"


def main() -> int:
    """Run the tests of the suite for longer."""
    cars.MOTION_S, cars.FRAMES = 60.0, 30_000
    console = plain_console()
    for name, test in product(
        cars.CARS,
        (
            cars.test_the_car_s_own_reader_finds_our_car_valid,
            cars.test_the_car_s_own_controller_holds_the_path_at_60_km_h,
            cars.test_every_counter_and_checksum_is_taken_on_both_sides,
            the_safety_code_accepts_the_traffic,
        ),
    ):
        with tempfile.TemporaryDirectory() as folder:  # a dialect of its own for each
            figures = test(name, Path(folder))
        console.print(f"{name}: {test.__name__}{f': {figures}' if figures else ''}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
