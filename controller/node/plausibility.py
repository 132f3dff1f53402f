"""Plausibility of the plant's signals: contradictions between them that no CRC can show.

Each residual compares what two signals say of one motion, and forgets in FORGETS_S:

    heading   Δψ' - (r - V ρ)                 curvature or yaw rate wrong, speed wrong
    lateral   y' - (V Δψ + V β + l_s r)       lateral or heading error wrong, speed wrong
    yaw       r - V δ/(L + K V²)              wheel angle or speed wrong
    command   δ - u                           the wheel does not do what the echo names
    side      δ - u, at most |δ|              a wheel that is limited goes to the other side

with SAE 2018-01-1086 (1), the steady V β = (l_r - m l_f V²/(c_r L)) r and the understeer gradient K
of the nominal vehicle; one that steers at the rear has V β = -(l_f + m l_r V²/(c_f L)) r. Which of
the two it is never changes, and no signal tells. So the lateral error counts only from when the
motion has shown that it is not steered at the rear. Only the heading is compared without a vehicle,
and the command only for a law that sends no plans.

A residual is implausible beyond its floor, which noise and side wind reach, plus a share of all
that moved, which other vehicles reach; the signals contradict each other once they have been
implausible for DEBOUNCE_S longer than they have not. What moves too little to show is not found,
and does little harm.

A step adds at most this bound to a residual, so that a single forged VEHICLE_STATE is forgotten
before it counts.

Signals are opposed if what they say of the motion also correlates by less than OPPOSED: one of them
has the wrong sign. No vehicle, lag or offset does that, and no law can steer by such signals.

A limited wheel lags behind its command, by a quarter of a swing at most: its side alone is judged.

The means of all VEHICLE_STATE since the last judgement are judged with the controller's status.
"""

from collections.abc import Sequence
from math import copysign, exp, inf, sqrt
from typing import NamedTuple

from ...dbc.messages import VehicleState
from ...runtime.fast_named_tuple import new_record
from ..filters.nominal_model import NominalVehicle, understeer_gradient_s2_m
from ..filters.settings import VehicleModelSettings
from ..settings import ControllerSettings

FORGETS_S = 1.0
DEBOUNCE_S = 1.0
OPPOSED, OPPOSED_S = -0.5, 0.5
"""Signals that agree correlate by 1, noise alone by 0, and a wrong sign by -1."""
SIDE_S = 0.9
"""In place of OPPOSED_S for the side of a limited wheel. Commands that are forged for a second turn
it too, and so does a dead time in the steering, which no echo shows. After 0.7 s such commands stop
a controller for good; each further tenth lets a car at 60 km/h go two metres further off."""


class Bound(NamedTuple):
    """Floor, in the unit of the residual times seconds, and share of what moved.

    ``debounce_s``, ``opposed_s``  after how long a residual beyond it counts, and an opposed one
    """

    floor: float
    share: float
    debounce_s: float = DEBOUNCE_S
    opposed_s: float = OPPOSED_S


BOUNDS = {
    "heading": Bound(0.02, 0.1),  # rad
    "lateral": Bound(0.05, 0.15),  # m
    "behind": Bound(0.05, 0.15),  # m
    "yaw": Bound(0.1, 0.3),  # rad
    "command": Bound(0.01, 0.08),  # rad s
    "side": Bound(0.01, 0.08, inf, SIDE_S),  # rad s
}
_COMPARES = {
    "heading": {"heading_error_rad", "yaw_rate_rad_s", "speed_m_s", "preview_curvature_1_m"},
    "lateral": {"lateral_error_m", "heading_error_rad", "yaw_rate_rad_s", "speed_m_s"},
    "behind": {"lateral_error_m", "heading_error_rad", "yaw_rate_rad_s", "speed_m_s"},
    "yaw": {"yaw_rate_rad_s", "wheel_angle_rad", "speed_m_s"},
    "command": {"wheel_angle_rad"},
    "side": {"wheel_angle_rad"},
}
_IN_WORDS = {
    "heading": "heading error, yaw rate, speed and curvature contradict each other",
    "lateral": "lateral error, heading error, yaw rate and speed contradict each other",
    "yaw": "yaw rate, wheel angle and speed contradict each other",
    "command": "the wheel angle is not that of the command in effect",
    "side": "the wheel turns to the other side than the command in effect",
}


def nominal_vehicle(settings: ControllerSettings) -> NominalVehicle | None:
    """Return the vehicle of the settings; None where there is only its transfer function."""
    model = settings.nominal_model
    return model.vehicle if isinstance(model, VehicleModelSettings) else None


class Motion(NamedTuple):
    """Means since the last judgement, and how long that is.

    ``along_m_s``  V Δψ
    ``turn_rad_s`` V ρ
    """

    lasted_s: float
    speed_m_s: float
    yaw_rate_rad_s: float
    turn_rad_s: float
    along_m_s: float
    wheel_rad: float
    command_rad: float


Reported = tuple[VehicleState, float, float, float]
"""A VEHICLE_STATE, and the newest heading error, wheel angle and command in effect [rad]."""


def mean_motion(reported: Sequence[Reported], lasted_s: float) -> Motion:
    """Return the means of what was reported, one or more, in ``lasted_s``."""
    a = b = c = d = e = f = 0.0
    for state, heading_rad, wheel_rad, command_rad in reported:
        v, r, rho = state.speed_m_s, state.yaw_rate_rad_s, state.preview_curvature_1_m
        a, b, c, d = a + v, b + r, c + v * rho, d + v * heading_rad
        e, f = e + wheel_rad, f + command_rad
    n = len(reported)
    return Motion(lasted_s, a / n, b / n, c / n, d / n, e / n, f / n)


class Compared(NamedTuple):
    """How far the vehicle moved in a step by either signal, and how far all their parts did."""

    one: float
    other: float
    parts: float


class Memory(NamedTuple):
    """What is left of the steps of one comparison.

    ``residual``, ``parts``     sums of one - other, and of the parts
    ``product``, ``one_2``, ``other_2``   sums of one other, one² and other²
    ``beyond_s``, ``opposed_s``  how much longer it has been implausible, or opposed, than not
    """

    residual: float = 0.0
    parts: float = 0.0
    product: float = 0.0
    one_2: float = 0.0
    other_2: float = 0.0
    beyond_s: float = 0.0
    opposed_s: float = 0.0


def compared(one: float, other: float, part: float = 0.0) -> Compared:
    """Return the comparison of ``one`` with ``other + part``."""
    return new_record(Compared, (one, other + part, abs(one - part) + abs(other)))


def memory_step(bound: Bound, x: Memory, moved: Compared, lasted_s: float, kept: float) -> Memory:
    """Take what has moved in ``lasted_s``; ``kept`` is the share that is not forgotten in it."""
    (one, other, parts), (floor, share, _, _) = moved, bound
    residual, parts_before, product, one_2, other_2, beyond_s, opposed_s = x
    parts += parts_before
    allowed = floor + share * parts
    step = one - other
    if not -allowed <= step <= allowed:
        step = copysign(allowed, step)
    residual = kept * (residual + step)
    product = kept * (product + one * other)
    one_2, other_2 = kept * (one_2 + one * one), kept * (other_2 + other * other)
    is_beyond = abs(residual) > floor + share * kept * parts
    is_opposed = is_beyond and product < OPPOSED * sqrt(one_2 * other_2)
    beyond_s += lasted_s if is_beyond else -lasted_s
    opposed_s += lasted_s if is_opposed else -lasted_s
    beyond_s, opposed_s = max(beyond_s, 0.0), max(opposed_s, 0.0)
    after = (residual, kept * parts, product, one_2, other_2, beyond_s, opposed_s)
    return new_record(Memory, after)


class Plausibility:
    """Judges the signals.

    ``vehicle``   the nominal one, None if unknown
    ``has_plans`` whether the commands are sent as plans

    ``contradiction``  what contradicts what, once that is known; empty before
    ``is_opposed``     whether that is for a wrong sign
    """

    def __init__(self, vehicle: NominalVehicle | None, *, has_plans: bool) -> None:
        self._vehicle = vehicle
        by_vehicle = () if vehicle is None else ("behind", "lateral", "yaw")
        self._names = ("heading", *by_vehicle, *(() if has_plans else ("command", "side")))
        self._may_steer_behind = vehicle is not None
        self.contradiction, self.is_opposed = "", False
        self.restart()

    def leave_out(self, missing: frozenset[str]) -> None:
        """Compare no signal that the bus does not carry; its value is 0."""
        self._names = tuple(one for one in self._names if not _COMPARES[one] & missing)
        self._may_steer_behind &= "behind" in self._names
        self.restart()

    def restart(self) -> None:
        """Forget all residuals, as after a message that was missing."""
        self._before: tuple[float, float] | None = None
        self._memories = dict.fromkeys(self._names, Memory())

    def step(
        self, motion: Motion, lateral_error_m: float, heading_error_rad: float, aim_rad: float
    ) -> None:
        """Judge the motion since the last step by the newest errors.

        ``aim_rad``  the command in effect, of a wheel that is limited too
        """
        before, self._before = self._before, (lateral_error_m, heading_error_rad)
        if before is None:
            return
        errors = lateral_error_m - before[0], heading_error_rad - before[1]
        moved = self._moved(motion, *errors, aim_rad)
        kept = exp(-motion.lasted_s / FORGETS_S)
        for name in self._names:
            bound = BOUNDS[name]
            after = memory_step(bound, self._memories[name], moved[name], motion.lasted_s, kept)
            self._memories[name] = after
            if name == "behind":
                self._may_steer_behind &= after.beyond_s == 0.0
            elif not (name == "lateral" and self._may_steer_behind):
                is_opposed = after.opposed_s >= bound.opposed_s
                is_found = after.beyond_s >= bound.debounce_s and not self.contradiction
                if is_found or (is_opposed and not self.is_opposed):
                    self.contradiction, self.is_opposed = _IN_WORDS[name], is_opposed

    def _moved(
        self, motion: Motion, error_m: float, heading_rad: float, aim_rad: float
    ) -> dict[str, Compared]:
        """Return how far it moved by each comparison."""
        lasted_s, v, r, turn, along, wheel_rad, command_rad = motion
        turned_rad = r * lasted_s
        side_rad = copysign(min(abs(wheel_rad), abs(aim_rad)), aim_rad)
        moved = {
            "heading": compared(heading_rad + turn * lasted_s, turned_rad),
            "command": compared(wheel_rad * lasted_s, command_rad * lasted_s),
            "side": compared(wheel_rad * lasted_s, side_rad * lasted_s),
        }
        if self._vehicle is not None:
            m, _, c_f, c_r, l_f, l_r, l_s, _ = self._vehicle
            length, along_m = l_f + l_r, along * lasted_s
            mv2 = m * v * v / length
            sides_m = l_r - mv2 * l_f / c_r, -l_f - mv2 * l_r / c_f
            steer_m = length + understeer_gradient_s2_m(self._vehicle) * v * v
            moved["yaw"] = compared(turned_rad, v * wheel_rad / steer_m * lasted_s)
            for name, side_m in zip(("lateral", "behind"), sides_m, strict=True):
                moved[name] = compared(error_m, (l_s + side_m) * turned_rad, along_m)
        return moved
