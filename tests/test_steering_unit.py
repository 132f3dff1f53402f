"""The steering's control unit: what it counts, says and reports; and what of it is known before."""

from plant_emulator.steering_unit import followed
from tests.test_steering_guard import MS_NS, Guarded


def test_which_commands_are_followed_is_known_from_their_times() -> None:
    guarded = Guarded(recovery_frames=2, hold_ms=20.0, override_ms=700.0)
    times_ms = [0.0, 140.0, 280.0 + 1e-6, 281.0, 420.0, 600.0, 610.0, 699.0, 700.0, 710.0]
    expected = [guarded.command(time_ms, 0.25) for time_ms in times_ms]
    assert expected == [True, True, False, True, True, False, True, True, True, False]
    assert followed(guarded.p, [round(t * MS_NS) for t in times_ms]) == expected
