"""SPEC.toml: the demands on the loop, the delays, and the paths.

Demands are of two kinds. Those in [d_stability] are of the PD loop and bound the region of the
gains, as in the paper; all others are of the whole law, for every corner of the vehicle's box and
every delay of the range.
"""

from math import pi
from typing import Annotated, Self

from pydantic import Field, PositiveFloat, model_validator

from ...closed_loop.parameter_space.d_stability import DStability, d_stability
from ...controller.filters.settings import QKind
from ...controller.laws import PAPER_LAWS
from ...controller.laws.predictor import FALLBACK
from ...controller.laws.settings import LawName
from ...controller.limits.steer_limits import LimitSettings
from ...plant_emulator.network.settings import Order
from ...plant_emulator.path.settings import PathSettings
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import Settings

_DELAYS_MAX = 500
DelayMs = Annotated[float, Field(ge=0.0, le=2000.0)]


def _up_to_ns(step_ms: float, last_ms: float) -> tuple[int, ...]:
    step_ns, last_ns = round(step_ms * NS_PER_MS), round(last_ms * NS_PER_MS)
    return (*range(0, last_ns, step_ns), last_ns)


class DelayTable(Settings):
    """`[delay]`: the constant delays from command to wheel angle for which the loop is designed.

    ``ms_max``     the range begins at 0
    ``step_ms``    from one delay that is tested to the next
    ``margin_ms``  beyond the range, where the loop has to be stable and no more
    """

    ms_max: DelayMs
    step_ms: Annotated[float, Field(ge=1.0, le=100.0)] = 5.0
    margin_ms: DelayMs = 0.0

    @model_validator(mode="after")
    def _refuse_endless_ranges(self) -> Self:
        count = (self.ms_max + self.margin_ms) / self.step_ms
        if count > _DELAYS_MAX:
            raise ValueError(
                f"{self.ms_max:g} + {self.margin_ms:g} ms in steps of {self.step_ms:g} ms are more"
                f" than {_DELAYS_MAX} delays"
            )
        return self

    def up_to_ns(self, last_ms: float) -> tuple[int, ...]:
        """Return 0, step, 2 step, ..., and the last one itself [ns]."""
        return _up_to_ns(self.step_ms, last_ms)


class ActuatorTable(Settings):
    """`[actuator]`: a lag 1/(lag s + 1) of the steering, to be survived up to some delay."""

    lag_s: Annotated[float, Field(gt=0.0, le=10.0)]
    delay_ms_max: DelayMs


class DStabilityTable(Settings):
    """`[d_stability]`: σ, θ and R of ``closed_loop.parameter_space.d_stability``.

    σ is demanded of the whole law too, everywhere in the range. θ and R bound the PD loop, without
    its observers, at ``delays_ms``.
    """

    settling_1_s: PositiveFloat  # σ
    cone_angle_deg: Annotated[float, Field(gt=90.0, lt=180.0)] = 135.0  # θ
    bandwidth_rad_s: PositiveFloat  # R
    delays_ms: tuple[DelayMs, ...] = (0.0,)

    @property
    def demands(self) -> DStability:
        """Return them as the analysis takes them."""
        return d_stability(self.settling_1_s, self.cone_angle_deg, self.bandwidth_rad_s)

    @property
    def delays_ns(self) -> tuple[int, ...]:
        """The delays of the PD loop [ns]."""
        return tuple(round(delay_ms * NS_PER_MS) for delay_ms in self.delays_ms)

    @model_validator(mode="after")
    def _refuse_what_no_roots_can_meet(self) -> Self:
        _ = self.demands
        return self


class CourseTable(Settings):
    """`[course]`: the paths to be driven, each from rest on it and for the same time.

    ``friction``           the least of the roads that the vehicle's virtual masses stand for
    ``friction_share_max``  how much of it the bends may need at the highest speed
    """

    duration_s: Annotated[float, Field(ge=0.2, le=3600.0)]
    friction: Annotated[float, Field(gt=0.0, le=2.0)] = 1.0
    friction_share_max: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    paths: Annotated[tuple[PathSettings, ...], Field(max_length=20)] = ()


class JitterTable(Settings):
    """`[[jitter]]`: commands with a new random latency each, newest wins; to be measured."""

    mean_ms: Annotated[float, Field(gt=0.0, le=2000.0)]
    spread_ms: Annotated[float, Field(gt=0.0, le=2000.0)]
    loss: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0


class ConditionsTable(Settings):
    """`[[predictor.conditions]]`: a network and a steering with which no run may leave the path.

    ``correlation_ms``  of the latencies, an AR(1) process; 0: each frame's is independent
    ``burst_frames``    mean length of a burst of loss; none: losses are independent
    ``order``           as in the plant's [latency.downlink]
    ``lag_ms``          of the steering, which the preset does not know
    ``error_m_max``     largest lateral error of any run
    """

    mean_ms: DelayMs
    spread_ms: DelayMs = 0.0
    correlation_ms: Annotated[float, Field(ge=0.0, le=1e5)] = 0.0
    loss: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    burst_frames: Annotated[float, Field(ge=1.0, le=1e4)] | None = None
    order: Order = Order.NEWEST_WINS
    lag_ms: DelayMs = 0.0
    error_m_max: PositiveFloat


class RoadTable(Settings):
    """`[predictor.road]`: the roads of a study, in place of the course.

    ``study``        a file, or a study that comes with the program
    ``path_known``   whether the plant sends PATH_AHEAD, and the law reads VEHICLE_STATE's curvature
                     where that has not come
    ``error_m_max``  largest deviation of the vehicle, with the tyres of its own [car]
    ``off_error_m_max``  the same of one that is heavier and softer by ``off_share``
    """

    study: str = "holding_the_road"
    path_known: bool = False
    error_m_max: PositiveFloat
    off_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.2
    off_error_m_max: PositiveFloat


class PredictorTable(Settings):
    """`[predictor]`: how the predictor is judged, besides its peak sensitivity and noise gain.

    ``road``                    in place of the course
    ``lag_margin_ms``           by how much more lag the law believes in than the steering has, for
                                play, tyres and the safe side; searched between the two; none:
                                it believes in no lag
    ``reads_yaw_rate``          whether the law does; the noise that it assumes of it is searched
    ``conditions``              judged with the seeds 1 to ``seeds``
    ``values_per_range``        2: the corners of the box; more: also between them
    ``measures_lag``, ``measures_mass``, ``lateral_acceleration_m_s2_max``  become the preset's
                                [predictor]
    ``delay_averaging_s``       becomes the preset's [link]
    ``fallback``                the pd_ddob it falls back to, a preset of the controller; none: the
                                one designed in the same run
    ``margin_ms``               beyond the longest delay, within which every vehicle is stable
    ``lateral_error_noise_m``, ``heading_error_noise_rad``  of the sensors, per sample, as the
                                filter assumes it
    """

    road: RoadTable | None = None
    lag_margin_ms: tuple[DelayMs, DelayMs] | None = None
    reads_yaw_rate: bool = False
    conditions: tuple[ConditionsTable, ...] = ()
    seeds: Annotated[int, Field(ge=1, le=100)] = 2
    values_per_range: Annotated[int, Field(ge=2, le=9)] = 2
    measures_lag: bool = False
    measures_mass: bool = False
    lateral_acceleration_m_s2_max: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    delay_averaging_s: Annotated[float, Field(gt=0.0, le=60.0)] = 0.5
    fallback: str | None = None
    delay_ms_max: DelayMs = 500.0
    margin_ms: DelayMs = 0.0
    delay_step_ms: Annotated[float, Field(ge=1.0, le=1000.0)] = 50.0
    lateral_error_noise_m: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.02
    heading_error_noise_rad: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.002
    horizon_s_max: Annotated[float, Field(gt=0.0, le=2.0)] = 1.0
    generations: Annotated[int, Field(ge=1, le=10_000)] = 12

    @property
    def delays_ns(self) -> tuple[int, ...]:
        """The delays that are judged [ns]."""
        return _up_to_ns(self.delay_step_ms, self.delay_ms_max)

    @model_validator(mode="after")
    def _refuse_margins_that_do_not_rise(self) -> Self:
        low_ms, high_ms = self.lag_margin_ms or (1.0, 2.0)
        if not 0.0 < low_ms < high_ms:
            raise ValueError("lag_margin_ms must be two rising values above 0")
        return self


class RmsTable(Settings):
    """`[rms_m_max]`: the largest RMS of the car a law may have; none if left out [m]."""

    pd: PositiveFloat | None = None
    pid: PositiveFloat | None = None
    pd_dob: PositiveFloat | None = None
    pd_cdob: PositiveFloat | None = None
    pd_ddob: PositiveFloat | None = None


class SearchTable(Settings):
    """`[search]`: of the evolution strategy; the same seed finds the same design."""

    seed: Annotated[int, Field(ge=0)] = 1
    starts: Annotated[int, Field(ge=1, le=100)] = 2
    generations: Annotated[int, Field(ge=1, le=10_000)] = 150  # of each start, at most


def controller_law(law: str) -> str:
    """Return what a law that is designed is called in the controller's settings."""
    return law.removesuffix("_heading")


class Specification(Settings):
    """All of SPEC.toml."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    """Prefix of the presets' names; the law follows."""
    laws: tuple[LawName, ...]
    rate_hz: Annotated[float, Field(ge=10.0, le=1000.0)] = 100.0
    pid_heading_gain: bool = False
    """Whether the law pid gets a gain on the heading error too; its preset is NAME_pid_heading."""
    dob_q_kind: QKind = "type_2"
    peak_sensitivity_max: Annotated[float, Field(gt=1.0, le=100.0)]
    noise_gain_rad_m_max: PositiveFloat
    """Standard deviation of the steer for white noise of 1 m on the lateral error; where a law
    reads the heading error, with a tenth of a radian per metre on that too."""
    delay: DelayTable
    actuator: ActuatorTable | None = None
    d_stability: DStabilityTable
    ignore_s: Annotated[float, Field(ge=0.0, le=600.0)] = 0.0
    """Left out of each run: no law can react before a command acts."""
    follows_car: bool = True
    """Whether the laws put the car on the path, by curvature and speed, or the preview point."""
    limits: LimitSettings = LimitSettings()
    """Must not be reached on any path; the preset limits every command to it."""
    rms_m_max: RmsTable = RmsTable()
    course: CourseTable
    jitter: tuple[JitterTable, ...] = ()
    predictor: PredictorTable | None = None
    """Only for the law predictor, which is designed last."""
    search: SearchTable = SearchTable()

    @property
    def period_ns(self) -> int:
        """The control period [ns]."""
        return round(NS_PER_S / self.rate_hz)

    @property
    def delays_ns(self) -> tuple[int, ...]:
        """The delays of the range [ns]."""
        return self.delay.up_to_ns(self.delay.ms_max)

    @property
    def road(self) -> RoadTable | None:
        """What stands in for the course."""
        return None if self.predictor is None else self.predictor.road

    def rms_m_max_of(self, law: str) -> float | None:
        """Return the largest RMS of a law [m]."""
        value: float | None = getattr(self.rms_m_max, controller_law(law))
        return value

    @model_validator(mode="after")
    def _refuse_runs_that_are_left_out(self) -> Self:
        if self.ignore_s >= self.course.duration_s:
            raise ValueError(f"ignore_s = {self.ignore_s:g} must be below course.duration_s")
        return self

    @model_validator(mode="after")
    def _refuse_a_bandwidth_beyond_nyquist(self) -> Self:
        nyquist_rad_s = pi * self.rate_hz
        if self.d_stability.bandwidth_rad_s >= nyquist_rad_s:
            raise ValueError(
                f"d_stability.bandwidth_rad_s = {self.d_stability.bandwidth_rad_s:g} must be below"
                f" pi * rate_hz = {nyquist_rad_s:.4g} rad/s"
            )
        return self

    @model_validator(mode="after")
    def _refuse_no_law_and_a_law_twice(self) -> Self:
        if not self.laws:
            raise ValueError("laws must name at least one law")
        if len(set(self.laws)) < len(self.laws):
            raise ValueError("laws names a law twice")
        unknown = set(self.laws) - {*PAPER_LAWS, "pid", "predictor", "packet"}
        if unknown:
            names = ", ".join(sorted(unknown))
            raise ValueError(f"laws: {names} cannot be designed here")
        if "packet" in self.laws and "predictor" not in self.laws:
            raise ValueError("law 'packet' needs 'predictor' among the laws")
        if not self.course.paths and (
            self.road is None or set(self.laws) - {"predictor", "packet"}
        ):
            raise ValueError("course.paths is empty: only laws on [predictor.road] need none")
        if "predictor" in self.laws:
            if self.predictor is None:
                raise ValueError("law 'predictor' needs the table [predictor]")
            if self.predictor.fallback is None and FALLBACK not in self.laws:
                raise ValueError(
                    "law 'predictor' needs predictor.fallback, the name of a preset, or 'pd_ddob'"
                    " among the laws"
                )
        return self
