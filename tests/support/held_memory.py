"""Checks that the memory held by the two nodes does not grow with the length of a run.

One pair runs in virtual time, with faults of every kind that makes a stage or a node store
something, for ten times the warm-up. Counted are the bytes of every object that can be reached from
the two nodes, the fault stage and the bus, at many moments of the last tenth and of the warm one.
The content of queues differs from moment to moment, so the peaks are compared. Neither clock nor
allocator is read: the same settings give the same bytes, except for a few that the interpreter
shares.

    python -m tests.support.held_memory [SECONDS]

measures a run, of ten minutes by default, which takes two to three.
"""

import gc
import sys
from collections.abc import Sequence
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import NamedTuple

from steer_by_wire.closed_loop.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.faults.settings import FaultKind
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.motion_parameters import MotionParams
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.virtual_time import VirtualTimeExecutor

LONGER = 10
"""Length of the run in warm-ups."""
LOOKS = 10
"""Moments at which the bytes are counted, in the warm-up's second half and as long at the end."""
GROWTH_BYTES_MAX = 16.0
"""Bytes a control period, those of the smallest object: what is kept of every period takes more."""
_SHARED = (type, ModuleType, FunctionType, BuiltinFunctionType, CodeType, MotionParams)
"""Belongs to the program, or was designed before the run."""
_FAULTS: tuple[tuple[FaultKind, str, str, float], ...] = (
    (FaultKind.DROP, "uplink", "LATERAL_ERROR", 0.1),
    (FaultKind.BURST_LOSS, "downlink", "STEERING_COMMAND", 3),
    (FaultKind.DUPLICATE, "uplink", "LATERAL_ERROR", 0.2),
    (FaultKind.REORDER, "downlink", "STEERING_COMMAND", 3),
    (FaultKind.DELAY_SPIKE, "uplink", "VEHICLE_STATE", 0.3),
    (FaultKind.BIT_FLIPS, "downlink", "STEERING_COMMAND", 0.002),
    (FaultKind.REPLAY, "uplink", "STEERING_STATUS", 1.0),
    (FaultKind.WRONG_IDENTIFIER, "uplink", "VEHICLE_STATE", 0.1),
    (FaultKind.NOISE, "uplink", "LATERAL_ERROR", 0.01),
)
"""Kind, direction, message and magnitude; all last from the first second to the end."""


class Memory(NamedTuple):
    """Peaks of the bytes held when warm, and at the end of a run of ``run_s``.

    ``periods``  control periods in between
    """

    warm_bytes: int
    late_bytes: int
    run_s: float
    periods: int

    @property
    def growth_bytes(self) -> float:
        """By how many bytes a control period the later peak is higher."""
        return (self.late_bytes - self.warm_bytes) / self.periods


def measure_memory(controller: ControllerSettings, run_s: float, seed: int = 1) -> Memory:
    """Run a pair with faults for ``run_s``, and count the bytes it holds then and when warm."""
    warm_s = run_s / LONGER
    plant = PlantSettings.model_validate(
        {
            "seed": seed,
            "duration_s": 2.0 * run_s,
            "latency": {
                way: {"model": "gamma", "mean_s": 0.04, "spread_s": 0.02}
                for way in ("downlink", "uplink")
            },
            "faults": [
                {
                    "kind": kind,
                    "direction": direction,
                    "message": message,
                    "signal": "lateral_error_m" if kind is FaultKind.NOISE else None,
                    "onset_s": 1.0,
                    "magnitude": magnitude,
                }
                for kind, direction, message, magnitude in _FAULTS
            ],
        }
    )
    pair = make_virtual_pair(plant, controller, plant_samples_max=0)
    bus = QuietBus(QUIET_BUS.bitrate_bit_s)
    executor = VirtualTimeExecutor((pair.edge, pair.controller), bus)

    def peak(from_s: float, to_s: float) -> int:
        peaks = []
        for look in range(1, LOOKS + 1):
            executor.run(round((from_s + (to_s - from_s) * look / LOOKS) * NS_PER_S))
            peaks.append(held_bytes((pair.edge, pair.controller, bus)))
        return max(peaks)

    warm_bytes = peak(0.5 * warm_s, warm_s)
    periods = round((run_s - warm_s) * NS_PER_S / controller.period_ns)
    return Memory(warm_bytes, peak(run_s - 0.5 * warm_s, run_s), run_s, periods)


def held_bytes(roots: Sequence[object]) -> int:
    """Return the bytes of every object that can be reached from ``roots``."""
    # A generator holds its frame, and the frame holds the names of its module.
    seen: dict[int, object] = {id(vars(module)): None for module in [*sys.modules.values()]}
    waiting: list[object] = [*roots]
    while waiting:
        held = waiting.pop()
        if id(held) in seen or isinstance(held, _SHARED):
            continue
        seen[id(held)] = held  # kept, so that no other gets its id
        waiting += gc.get_referents(held)
    return sum(map(sys.getsizeof, seen.values()))


def main() -> int:
    """Measure and print; returns 1 where memory grows."""
    run_s = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    held = measure_memory(controller_preset("practical_pd_ddob"), run_s)
    sys.stdout.write(f"{held}: {held.growth_bytes:.1f} bytes a control period\n")
    return held.growth_bytes >= GROWTH_BYTES_MAX


if __name__ == "__main__":
    sys.exit(main())
