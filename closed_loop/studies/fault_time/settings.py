"""Settings file of the study of fault times: a table `[fault_time]`."""

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import Field

from ....runtime.settings import Settings, load_settings


class FaultName(StrEnum):
    """A fault; the last two leave a part of the torque."""

    SILENCE = "silence"
    """No command arrives."""
    STUCK = "stuck"
    """The wheels do not move."""
    OFFSET = "offset"
    """The angle sensor is wrong by the steer of ``offset_m_s2``."""
    WRONG_SIGN = "wrong sign"
    HALF_TORQUE = "half torque"
    LOST_CHANNEL = "lost channel"
    """One of two windings of the motor."""


class FallbackName(StrEnum):
    """A fallback of `[safety]`; the last also brakes."""

    RAMP_TO_ZERO = "ramp_to_zero"
    KEEP = "keep"
    FOLLOW_PATH = "follow_path"
    FOLLOW_AND_STOP = "follow_path and stop"


Speed = Annotated[float, Field(ge=10.0, le=200.0)]


class SceneSettings(Settings):
    """One `[[fault_time.scenes]]`: a case with a name."""

    name: str = Field(min_length=1, max_length=60)
    speed_km_h: Speed
    radius_m: float | None = Field(None, ge=10.0, le=1e5)
    """If omitted, a straight road."""


class FaultTimeSettings(Settings):
    """`[fault_time]`; all defaults are chosen."""

    title: str = Field("", max_length=200)
    plant_preset: str = "bmw_320i"
    plant: tuple[str, ...] = ("car.rack={}",)
    """Settings on top of the preset, KEY=VALUE; it has to be a car with `[car.rack]`."""
    controller_preset: str = "highway_pd"
    """A law that is designed for each speed takes minutes where the car brakes."""
    faults: tuple[FaultName, ...] = Field(tuple(FaultName), min_length=1)
    fallbacks: tuple[FallbackName, ...] = Field(tuple(FallbackName), min_length=1)
    speeds_km_h: tuple[Speed, ...] = (30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
    bends_m_s2: tuple[Annotated[float, Field(ge=0.0, le=8.0)], ...] = (0.0, 2.0)
    """Lateral acceleration of each bend; 0 is a straight road."""
    scenes: tuple[SceneSettings, ...] = ()
    bank_m_s2: float = Field(0.2, ge=-3.0, le=3.0)
    """Of the road: a cross fall of 2 %, which a wheel let go gives way to."""
    offset_m_s2: float = Field(2.0, ge=0.1, le=10.0)
    stop_m_s2: float = Field(4.0, ge=0.1, le=10.0)
    onset_s: float = Field(3.0, ge=1.0, le=60.0)
    """Of the fault, once the loop has settled."""
    time_s_max: float = Field(4.0, ge=0.1, le=60.0)
    """No longer time is tried."""
    scan_s: float = Field(0.2, ge=0.01, le=10.0)
    """From one time that is tried to the next."""
    resolution_s: float = Field(0.01, ge=0.001, le=1.0)
    """Of the time, between two of these."""
    watch_s: float = Field(6.0, ge=1.0, le=60.0)
    """From the beginning of the fallback on, until a driver takes over."""


class Case(NamedTuple):
    """A fault on a road at a speed, and the fallback."""

    road: str
    fault: FaultName
    fallback: FallbackName
    speed_km_h: float
    curvature_1_m: float


def cases_of(settings: FaultTimeSettings) -> Iterator[Case]:
    """Yield all cases; those of scenes are last."""
    roads = [
        (f"{bend:g} m/s²" if bend else "straight", speed, bend / (speed / 3.6) ** 2)
        for bend in settings.bends_m_s2
        for speed in settings.speeds_km_h
    ]
    roads += [
        (scene.name, scene.speed_km_h, 1.0 / scene.radius_m if scene.radius_m else 0.0)
        for scene in settings.scenes
    ]
    for fallback in settings.fallbacks:
        for fault in settings.faults:
            for name, speed_km_h, curvature_1_m in roads:
                yield Case(name, fault, fallback, speed_km_h, curvature_1_m)


class _File(Settings):
    fault_time: FaultTimeSettings


def read_fault_time(file: Path) -> FaultTimeSettings:
    """Return the table of a file; raises SettingsError."""
    return load_settings(_File, file=file).fault_time
