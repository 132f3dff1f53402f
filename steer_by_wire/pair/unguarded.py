"""A rig whose steering refuses nothing: to judge laws, not the guard that would hide a bad one."""

from ..plant_emulator.safety_settings import OFF, SafetySettings

UNGUARDED = SafetySettings(
    angle_rad_max=OFF,
    angle_rate_rad_s_max=OFF,
    lateral_acceleration_m_s2_max=OFF,
    lateral_jerk_m_s3_max=OFF,
    follow_tolerance_rad=OFF,
    ftti_ms=OFF,
)
