"""The step functions that compiled loops may call: the same objects that run live.

``register_jitable`` leaves a function as it is and lets numba compile it where a compiled one calls
it. There is no second formulation of any arithmetic, so a compiled run gives the same bits.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

from numba.extending import overload, register_jitable

from controller import (
    cdob,
    delayed_set_point,
    dob,
    estimator,
    fading,
    feed_forward,
    kalman_laws,
    limits,
    link,
    link_memory,
    paper_laws,
    pd,
    predictor,
    sections,
    sensor_rate,
    smith,
)
from controller.law_interface import LawInput
from plant_emulator import (
    actuator,
    loss,
    motion,
    path,
    propagation,
    safety_limiter,
    steering_guard,
    steering_unit,
)

_STEP_FUNCTIONS: tuple[Callable[..., Any], ...] = (
    sections.section_step,
    sections.cascade_2_step,
    sections.cascade_3_step,
    pd.pd_step,
    dob.dob_step,
    cdob.cdob_step,
    paper_laws.pd_law_step,
    paper_laws.pd_dob_step,
    paper_laws.pd_cdob_step,
    paper_laws.pd_ddob_step,
    link.delay_step,
    link.delay_of,
    link.unwrapped,
    sensor_rate.rate_step,
    link_memory.history_of,
    link_memory.error_step,
    link_memory.echo_step,
    link_memory.command_step,
    link_memory.link_at,
    link_memory._sample_of,
    link_memory._tick_of,
    link_memory._is_late,
    estimator.estimator_at_rest,
    estimator.model_step,
    estimator.correction_step,
    estimator.sent_at,
    estimator._mean_command,
    estimator._acting_at,
    estimator.command_from,
    estimator.estimate_to,
    estimator.start_estimate,
    predictor._horizon,
    predictor.predict,
    predictor.steer_for,
    predictor.predictor_step,
    kalman_laws.error_rate_m_s,
    kalman_laws._corrected,
    kalman_laws.derivative_step,
    kalman_laws.kalman_pd_step,
    kalman_laws.kalman_pd_dob_step,
    kalman_laws.kalman_pd_cdob_step,
    kalman_laws.kalman_pd_ddob_step,
    smith.command_at,
    smith.smith_step,
    feed_forward.steer_per_curvature,
    feed_forward.curve_steer,
    feed_forward.curve_step,
    feed_forward.feed_forward_step,
    delayed_set_point.delay_of_requests,
    delayed_set_point.request_before,
    delayed_set_point.delayed_set_point_step,
    limits.limit_step,
    limits.ramp_step,
    fading.fading_step,
    loss.loss_step,
    propagation.propagate,
    actuator.at_rest,
    actuator.command_wheel,
    actuator.end_ramp,
    actuator._after_ramp,
    path.next_place,
    path.end_of_place_m,
    motion._coast,
    motion._move_wheel,
    motion._enter_place,
    motion._enter_interval,
    motion.start_motion,
    motion.advance_motion,
    motion.command_motion,
    safety_limiter.start_limiter,
    safety_limiter.with_followed,
    safety_limiter.limit_steer,
    safety_limiter.watch_wheel,
    steering_guard._towards_zero,
    steering_guard.start_guard,
    steering_guard.guard_command,
    steering_guard.guard_timer,
    steering_guard.guard_wheel,
    steering_guard.is_overruled,
    steering_unit.status_of,
)


def step_functions() -> tuple[Callable[..., Any], ...]:
    """Return what ``register_steps`` registers."""
    return _STEP_FUNCTIONS


@cache
def register_steps() -> None:
    """Let compiled functions call the step functions."""
    for function in _STEP_FUNCTIONS:
        # The entries for callers in C and in Python, which nobody needs, take long to compile.
        register_jitable(forceinline=True, no_cfunc_wrapper=True, no_cpython_wrapper=True)(function)


def law_step(params: Any, state: Any, seen: LawInput) -> Any:
    """Advance the law that ``params`` belong to; compiled code then calls that law directly."""
    if isinstance(params, feed_forward.FeedForwardParams):
        inside = _STEP_OF[type(params.law)]
        return feed_forward.feed_forward_step(inside, params, state, seen)
    return _STEP_OF[type(params)](params, state, seen)


_STEP_OF: dict[type, Callable[..., Any]] = {
    pd.PdParams: paper_laws.pd_law_step,
    paper_laws.PdDobParams: paper_laws.pd_dob_step,
    paper_laws.PdCdobParams: paper_laws.pd_cdob_step,
    paper_laws.PdDdobParams: paper_laws.pd_ddob_step,
    predictor.PredictorParams: predictor.predictor_step,
    kalman_laws.KalmanPdParams: kalman_laws.kalman_pd_step,
    kalman_laws.KalmanPdDobParams: kalman_laws.kalman_pd_dob_step,
    kalman_laws.KalmanPdCdobParams: kalman_laws.kalman_pd_cdob_step,
    kalman_laws.KalmanPdDdobParams: kalman_laws.kalman_pd_ddob_step,
    smith.SmithParams: smith.smith_step,
    delayed_set_point.DelayedSetPointParams: delayed_set_point.delayed_set_point_step,
}


@overload(law_step)
def _law_step_of_type(params: Any, state: Any, seen: Any) -> Any:  # noqa: ARG001
    """Choose by type, when compiling."""
    if params.instance_class is feed_forward.FeedForwardParams:
        inside = _STEP_OF[params.types[0].instance_class]

        def with_feed_forward(params: Any, state: Any, seen: Any) -> Any:
            return feed_forward.feed_forward_step(inside, params, state, seen)

        return with_feed_forward
    step = _STEP_OF[params.instance_class]

    def of_type(params: Any, state: Any, seen: Any) -> Any:
        return step(params, state, seen)

    return of_type
