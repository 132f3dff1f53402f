"""A steering that refuses nothing: for judging laws, since its limits could hide a bad one."""

from steer_by_wire.plant_emulator.steering.settings import SafetySettings

UNGUARDED = SafetySettings(
    angle_rad_max="off",
    angle_rate_rad_s_max="off",
    lateral_acceleration_m_s2_max="off",
    lateral_jerk_m_s3_max="off",
    follow_tolerance_rad="off",
    ftti_ms="off",
)
