"""Settings file of the standard tests: a table `[vehicle_tests]`."""

from pathlib import Path

from pydantic import Field

from ....runtime.settings import Settings, load_settings


class VehicleTestSettings(Settings):
    """`[vehicle_tests]`."""

    title: str = Field("", max_length=200)
    plants: tuple[str, ...] = Field(min_length=1)
    """Presets of cars."""
    plant: tuple[str, ...] = ()
    """Settings on top of each preset, KEY=VALUE."""
    speed_km_h: float = Field(100.0, ge=20.0, le=200.0)
    """Of all tests but the sine with dwell; the standard speed of ISO 7401."""
    lateral_m_s2: float = Field(4.0, ge=0.1, le=10.0)
    """Of the steady turn that step and sine have the steer of; the standard value of ISO 7401."""
    sine_hz: float = Field(0.5, ge=0.1, le=3.0)
    """The preferred frequency of ISO 7401."""


class _File(Settings):
    vehicle_tests: VehicleTestSettings


def read_vehicle_tests(file: Path) -> VehicleTestSettings:
    """Return the table of a file; raises SettingsError."""
    return load_settings(_File, file=file).vehicle_tests
