"""Tables of a run: what happened in plant and controller, as arrays on one time axis.

Time 0 is the start of motion. The plant is sampled once per sensor period and the controller once
per control period, so each has a table of its own; an array of a table has shape (rows,).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..controller.node.run_figures import ControlSample
from ..plant_emulator.evaluation.run_record import PlantSample
from ..runtime.array_types import FloatArray, IntArray

if TYPE_CHECKING:
    from .compiled.engine import BatchRun


class PlantTable(NamedTuple):
    """The true state of the rig, one row per sensor period; NaN where there is no value.

    Compiled runs have no ``uplink_latency_s`` and no ``side_slip_rad``: NaN.
    """

    time_s: FloatArray  #: since the start of motion
    arc_length_m: FloatArray  #: of the path, beside the preview point
    lateral_error_m: FloatArray  #: at the preview point, without noise, to the left positive
    heading_error_rad: FloatArray
    yaw_rate_rad_s: FloatArray
    command_rad: FloatArray  #: in effect, as it was on the wire
    wheel_angle_rad: FloatArray
    downlink_latency_s: FloatArray  #: of the command in effect
    uplink_latency_s: FloatArray  #: of the measurement that left last
    curvature_1_m: FloatArray  #: of the path, beside the preview point
    side_slip_rad: FloatArray
    cg_deviation_m: FloatArray  #: of the centre of gravity from the path, to the left positive

    @classmethod
    def of_samples(cls, samples: Sequence[PlantSample]) -> "PlantTable":
        """Collect the samples of a plant node."""
        return cls(*np.array(samples, dtype=np.float64).reshape(-1, len(cls._fields)).T.copy())

    @classmethod
    def of_batch(cls, batch: "BatchRun") -> "PlantTable":
        """Collect what a compiled run has."""
        unknown = np.full(len(batch.time_s), np.nan)
        return cls(*(getattr(batch, name, unknown) for name in cls._fields))


class ControllerTable(NamedTuple):
    """What the controller knew and decided, one row per control period from the first command on.

    Compiled runs have no ``measured_m`` and no ``sample_age_s``: NaN.
    """

    time_s: FloatArray  #: since the start of motion
    mode: IntArray  #: Mode: 1 is ACTIVE
    measured_m: FloatArray  #: the newest lateral error that has arrived
    sample_age_s: FloatArray  #: since that error arrived
    law_rad: FloatArray  #: what the law asked for, before limits
    sent_rad: FloatArray  #: the command, after limits
    disturbance_rad: FloatArray  #: d̂ of the DOB
    network_disturbance_rad: FloatArray  #: d̂_n of the CDOB
    compensated_error_m: FloatArray  #: y_fb: the error the law steers by

    @classmethod
    def of_samples(
        cls, samples: Sequence[ControlSample], motion_start_ns: int
    ) -> "ControllerTable":
        """Collect the samples of a controller node."""
        columns = np.array(
            [
                (
                    (sample.time_ns - motion_start_ns) * 1e-9,
                    sample.lateral_error_m,
                    sample.sample_age_ns * 1e-9,
                    sample.law_output.steer_rad,
                    sample.sent_steer_rad,
                    *sample.law_output[1:],
                )
                for sample in samples
            ],
            dtype=np.float64,
        )
        time_s, *others = columns.reshape(-1, len(cls._fields) - 1).T.copy()
        mode = np.array([sample.mode for sample in samples], dtype=np.int64)
        return cls(time_s, mode, *others)

    @classmethod
    def of_batch(cls, batch: "BatchRun") -> "ControllerTable":
        """Collect what a compiled run has."""
        ticks = len(batch.tick_s)
        mode = np.zeros(ticks, dtype=np.int64)
        for segment in batch.schedule.segments:
            mode[segment.first_tick : segment.last_tick] = segment.mode
        law_rad, *estimates = batch.law_output.T.copy()
        since_start_ns = batch.schedule.tick_ns[:ticks] - batch.schedule.motion_start_ns
        unknown = np.full(ticks, np.nan)
        return cls(
            np.multiply(since_start_ns, 1e-9),
            mode,
            unknown,
            unknown,
            law_rad,
            batch.sent_rad,
            *estimates,
        )


class Track(NamedTuple):
    """The run seen from above, one row per sensor period: preview point, and path beside it."""

    x_m: FloatArray
    y_m: FloatArray
    path_x_m: FloatArray
    path_y_m: FloatArray
