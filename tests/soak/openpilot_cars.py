"""Read and drive our cars by opendbc for a minute each, and exchange a million frames with it.

    python -m tests.soak.openpilot_cars

Needs the extra ``cars``. Takes about five minutes; the first thing that fails ends it.
"""

import sys
import tempfile
from itertools import product
from pathlib import Path

from steer_by_wire.closed_loop.reports.terminal import plain_console
from tests.system import test_openpilot_cars as cars


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
        ),
    ):
        with tempfile.TemporaryDirectory() as folder:  # a dialect of its own for each
            test(name, Path(folder))
        console.print(f"{name}: {test.__name__}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
