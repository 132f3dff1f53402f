"""One run of the delay estimation's study: the pair in virtual time, and DELAY_STATUS's content.

The truth is known to the rig alone:

    constant latencies   down + up, as configured; the wire takes no time
    varying latencies    by the frames that came through: the mean time from sending a command to
                         a sample that sees it act, - control period/2, and the mean over time of
                         the latency of the VEHICLE_STATE in use, since the estimate watches that.
                         Sent half as often as a STEERING_STATUS it is overtaken less, so older.
"""

from collections.abc import Sequence
from itertools import product
from math import nan
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.virtual_pair import make_virtual_pair
from ...controller.settings import controller_preset
from ...dbc import messages
from ...dbc.codec.protection import COUNTERS
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ...runtime.node.virtual_time import VirtualTimeExecutor

DURATION_S = 60.0
SEED = 7
STRAYED_M = 0.5
"""A lateral error beyond which the loop is not taken for stable."""
TOLERANCE_S = 0.01
SAMPLE_NS = 10_000_000
"""Time between two samples of the plant; every second one sends a VEHICLE_STATE."""
LAWS = ("pd", "pd_dob", "pd_cdob", "pd_ddob", "predictor")
PATHS = {
    "single lane change": {"kind": "single_lane_change"},
    "double lane change": {"kind": "double_lane_change"},
    "ellipse 60 x 30 m": {"kind": "ellipse", "semi_major_axis_m": 60.0, "semi_minor_axis_m": 30.0},
    "default ellipse": {"kind": "ellipse"},
}
CORNERS = {"a": (4.0, 1600.0), "b": (4.0, 5000.0), "c": (7.0, 1600.0), "d": (7.0, 5000.0)}
"""Speed [km/h] and virtual mass [kg]."""
NETWORKS: dict[str, dict[str, Any]] = {
    **{f"{ms} ms": {"mean_s": ms / 2000.0} for ms in (80, 160, 250, 320, 400)},
    "2 x 80 ± 30 ms": {"model": "gamma", "mean_s": 0.08, "spread_s": 0.03},
}
"""Latency of each direction."""
NOISES_M = (0.0, 0.02)
NO_DISTURBANCE = "none"
DISTURBANCES: dict[str, list[dict[str, float]]] = {
    NO_DISTURBANCE: [],
    "steering offset": [{"at_s": 20.0, "steering_offset_rad": 0.02}],
    "side force": [{"at_s": 8.0, "side_force_n": 1000.0}],
}
"""Steps of a disturbance beside the command."""


class Case(NamedTuple):
    """One run."""

    law: str
    path: str
    corner: str
    network: str
    noise_m: float
    disturbance: str = NO_DISTURBANCE


class History(NamedTuple):
    """The content of DELAY_STATUS; arrays of shape (messages,), NaN where nothing is known."""

    time_s: FloatArray
    echo_s: FloatArray
    estimate_s: FloatArray
    confidence: FloatArray
    truth_s: float


class Result(NamedTuple):
    """Figures of a run; errors of the estimate while observable [s], NaN if it never was."""

    case: Case
    is_stable: bool
    truth_s: float
    observable_share: float
    first_s: float
    within_tolerance: float
    error_p05_s: float
    error_p50_s: float
    error_p95_s: float
    error_max_s: float
    echo_error_s: float


def run_case(case: Case) -> tuple[Result, History]:
    """Run the pair; returns the figures and what they come from."""
    pair = make_virtual_pair(_plant_settings(case), controller_preset(f"practical_{case.law}"), 0)
    listener = _Listener()
    executor = VirtualTimeExecutor((pair.edge, pair.controller), None, listener.on_wire)
    until_ns = NS_PER_S
    while not executor.finished:
        executor.run(until_ns)
        until_ns += NS_PER_S
    history = listener.history(_configured_s(case))
    return _result(case, history, pair.plant.report()["lateral_error_peak_m"]), history


def _plant_settings(case: Case) -> PlantSettings:
    speed_km_h, mass_kg = CORNERS[case.corner]
    way = NETWORKS[case.network]
    return PlantSettings.model_validate(
        {
            "seed": SEED,
            "duration_s": DURATION_S,
            "vehicle": {"speed_m_s": speed_km_h / 3.6, "virtual_mass_kg": mass_kg},
            "path": PATHS[case.path],
            "sensor_noise": {"lateral_error_m": case.noise_m},
            "latency": {"downlink": way, "uplink": way},
            "disturbance": {"steps": DISTURBANCES[case.disturbance]},
        }
    )


def _configured_s(case: Case) -> float | None:
    """Return the delay that is configured, None where it varies [s]."""
    way = NETWORKS[case.network]
    return None if "model" in way else 2.0 * float(way["mean_s"])


def _result(case: Case, history: History, peak_m: float) -> Result:
    error_s = history.estimate_s - history.truth_s
    is_observable = np.isfinite(error_s)
    known_s = error_s[is_observable]
    quantiles_s = np.quantile(known_s, (0.05, 0.5, 0.95)) if known_s.size else [nan] * 3
    low_s, middle_s, high_s = map(float, quantiles_s)
    return Result(
        case,
        bool(peak_m < STRAYED_M),
        history.truth_s,
        float(is_observable.mean()),
        float(history.time_s[is_observable][0]) if known_s.size else nan,
        float((np.abs(known_s) <= TOLERANCE_S).mean()) if known_s.size else nan,
        low_s,
        middle_s,
        high_s,
        float(np.abs(known_s).max()) if known_s.size else nan,
        float(np.nanmean(history.echo_s) - history.truth_s),
    )


class _Listener:
    """Receives all frames of the wire, in virtual time from 0."""

    def __init__(self) -> None:
        self._reported: list[tuple[float, float, float, float]] = []
        self._sent_ns: dict[int, int] = {}
        self._down_ns: list[int] = []
        self._state_ns = self._state_up_ns = 0
        self._up_sum_ns = self._up_time_ns = 0
        self._status_number = self._state_number = -1

    def on_wire(self, time_ns: int, _sender: int, frame: Frame) -> None:
        """Take a frame."""
        decoded = messages.decode(frame)
        if not isinstance(decoded, messages.Decoded):
            return
        message, counter = decoded
        if isinstance(message, messages.DelayStatus):
            self._reported.append((time_ns / NS_PER_S, *_reported(message)))
        elif isinstance(message, messages.SteeringCommand):
            self._sent_ns[message.command_counter] = time_ns
        elif isinstance(message, messages.SteeringStatus):
            self._status_number = _next(self._status_number, counter)
            if message.status:
                sampled_ns = self._status_number * SAMPLE_NS
                self._down_ns.append(sampled_ns - self._sent_ns[message.applied_counter])
        elif isinstance(message, messages.VehicleState):
            self._state_number = _next(self._state_number, counter)
            self._up_sum_ns += self._state_up_ns * (time_ns - self._state_ns)
            self._up_time_ns += time_ns - self._state_ns if self._state_ns else 0
            self._state_ns = time_ns
            self._state_up_ns = time_ns - 2 * SAMPLE_NS * self._state_number

    def history(self, configured_s: float | None) -> History:
        """Return the reported estimates, and the truth."""
        truth_s = configured_s
        if truth_s is None:
            up_ns = self._up_sum_ns / self._up_time_ns
            truth_s = float(np.mean(self._down_ns) + up_ns - 0.5 * SAMPLE_NS) / NS_PER_S
        time_s, echo_s, estimate_s, confidence = np.array(self._reported).T
        return History(time_s, echo_s, estimate_s, confidence, truth_s)


def _next(number: int, counter: int) -> int:
    """Return the first number after ``number`` whose E2E counter is ``counter``."""
    return number + 1 + (counter - number - 1) % COUNTERS


def _reported(message: messages.DelayStatus) -> tuple[float, float, float]:
    """Return echo and estimate [s], NaN for what is not known, and the confidence."""
    is_known = message.echo_state is messages.EchoState.KNOWN
    is_observable = message.estimate_state is messages.EstimateState.OBSERVABLE
    return (
        message.echo_delay_s if is_known else nan,
        message.estimated_delay_s if is_observable else nan,
        message.confidence,
    )


def cases(
    laws: Sequence[str],
    paths: Sequence[str],
    networks: Sequence[str],
    corners: Sequence[str],
    disturbances: Sequence[str] = (NO_DISTURBANCE,),
) -> list[Case]:
    """Return every combination, each with and without noise."""
    combinations = product(laws, paths, networks, corners, NOISES_M, disturbances)
    return [
        Case(law, path, corner, network, noise_m, disturbance)
        for law, path, network, corner, noise_m, disturbance in combinations
    ]
