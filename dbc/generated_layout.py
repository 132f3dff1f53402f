"""The messages of ``steer_by_wire.dbc``; written by ``dbc.generate``, not by hand."""

from .layout import MessageLayout, SignalLayout

# fmt: off
LAYOUTS: tuple[MessageLayout, ...] = (
    MessageLayout(
        "STEERING_COMMAND", can_id=0x100, length=8, cycle_time_ms=10, data_id=0x5100,
        signals=(
            SignalLayout(
                "STEER", "steer_rad",
                start=24, length=18, is_signed=True, scale=1e-05, unit="rad",
                minimum=-1.31071, maximum=1.31071, not_available=-131072,
            ),
            SignalLayout(
                "COMMAND_COUNTER", "command_counter",
                start=42, length=16, is_signed=False, scale=1, unit="",
                minimum=0, maximum=65535, not_available=None,
            ),
            SignalLayout(
                "STEERING_COMMAND_MODE", "mode",
                start=58, length=3, is_signed=False, scale=1, unit="",
                minimum=0, maximum=3, not_available=None,
            ),
        ),
    ),
    MessageLayout(
        "LATERAL_ERROR", can_id=0x110, length=8, cycle_time_ms=10, data_id=0x5110,
        signals=(
            SignalLayout(
                "LATERAL_ERROR_LATERAL_ERROR", "lateral_error_m",
                start=24, length=25, is_signed=True, scale=5e-06, unit="m",
                minimum=-83.886075, maximum=83.886075, not_available=-16777216,
            ),
            SignalLayout(
                "HEADING_ERROR", "heading_error_rad",
                start=49, length=15, is_signed=True, scale=0.0002, unit="rad",
                minimum=-3.2766, maximum=3.2766, not_available=-16384,
            ),
        ),
    ),
    MessageLayout(
        "STEERING_STATUS", can_id=0x120, length=8, cycle_time_ms=10, data_id=0x5120,
        signals=(
            SignalLayout(
                "WHEEL_ANGLE", "wheel_angle_rad",
                start=24, length=18, is_signed=True, scale=1e-05, unit="rad",
                minimum=-1.31071, maximum=1.31071, not_available=None,
            ),
            SignalLayout(
                "APPLIED_COUNTER", "applied_counter",
                start=42, length=16, is_signed=False, scale=1, unit="",
                minimum=0, maximum=65535, not_available=None,
            ),
            SignalLayout(
                "STATUS", "status",
                start=58, length=3, is_signed=False, scale=1, unit="",
                minimum=0, maximum=6, not_available=None,
            ),
        ),
    ),
    MessageLayout(
        "VEHICLE_STATE", can_id=0x130, length=8, cycle_time_ms=20, data_id=0x5130,
        signals=(
            SignalLayout(
                "SPEED", "speed_m_s",
                start=24, length=14, is_signed=False, scale=0.005, unit="m/s",
                minimum=0, maximum=81.915, not_available=None,
            ),
            SignalLayout(
                "YAW_RATE", "yaw_rate_rad_s",
                start=38, length=13, is_signed=True, scale=0.0005, unit="rad/s",
                minimum=-2.0475, maximum=2.0475, not_available=None,
            ),
            SignalLayout(
                "PREVIEW_CURVATURE", "preview_curvature_1_m",
                start=51, length=13, is_signed=True, scale=5e-05, unit="1/m",
                minimum=-0.20475, maximum=0.20475, not_available=None,
            ),
        ),
    ),
    MessageLayout(
        "CONTROLLER_STATUS", can_id=0x300, length=8, cycle_time_ms=100, data_id=0x5300,
        signals=(
            SignalLayout(
                "CONTROLLER_STATUS_MODE", "mode",
                start=24, length=3, is_signed=False, scale=1, unit="",
                minimum=0, maximum=3, not_available=None,
            ),
            SignalLayout(
                "LAW", "law",
                start=27, length=5, is_signed=False, scale=1, unit="",
                minimum=0, maximum=7, not_available=None,
            ),
            SignalLayout(
                "DISTURBANCE", "disturbance_rad",
                start=32, length=12, is_signed=True, scale=0.001, unit="rad",
                minimum=-2.047, maximum=2.047, not_available=None,
            ),
            SignalLayout(
                "NETWORK_DISTURBANCE", "network_disturbance_rad",
                start=44, length=12, is_signed=True, scale=0.001, unit="rad",
                minimum=-2.047, maximum=2.047, not_available=None,
            ),
            SignalLayout(
                "SKIPPED_TICKS", "skipped_ticks",
                start=56, length=8, is_signed=False, scale=1, unit="",
                minimum=0, maximum=255, not_available=None,
            ),
        ),
    ),
    MessageLayout(
        "CONTROLLER_SAFETY", can_id=0x304, length=8, cycle_time_ms=100, data_id=0x5304,
        signals=(
            SignalLayout(
                "CONTROLLER_SAFETY_REJECTED", "rejected",
                start=24, length=12, is_signed=False, scale=1, unit="",
                minimum=0, maximum=4095, not_available=None,
            ),
            SignalLayout(
                "CONTROLLER_SAFETY_LOST", "lost",
                start=36, length=12, is_signed=False, scale=1, unit="",
                minimum=0, maximum=4095, not_available=None,
            ),
            SignalLayout(
                "LATERAL_ERROR_FRESHNESS", "lateral_error_freshness",
                start=48, length=2, is_signed=False, scale=1, unit="",
                minimum=0, maximum=2, not_available=None,
            ),
            SignalLayout(
                "STEERING_STATUS_FRESHNESS", "steering_status_freshness",
                start=50, length=2, is_signed=False, scale=1, unit="",
                minimum=0, maximum=2, not_available=None,
            ),
            SignalLayout(
                "VEHICLE_STATE_FRESHNESS", "vehicle_state_freshness",
                start=52, length=2, is_signed=False, scale=1, unit="",
                minimum=0, maximum=2, not_available=None,
            ),
            SignalLayout(
                "FAULT", "fault",
                start=54, length=3, is_signed=False, scale=1, unit="",
                minimum=0, maximum=2, not_available=None,
            ),
        ),
    ),
    MessageLayout(
        "DELAY_STATUS", can_id=0x308, length=8, cycle_time_ms=100, data_id=0x5308,
        signals=(
            SignalLayout(
                "ECHO_DELAY", "echo_delay_s",
                start=24, length=12, is_signed=False, scale=0.0005, unit="s",
                minimum=0, maximum=2.0475, not_available=None,
            ),
            SignalLayout(
                "ESTIMATED_DELAY", "estimated_delay_s",
                start=36, length=12, is_signed=False, scale=0.0005, unit="s",
                minimum=0, maximum=2.0475, not_available=None,
            ),
            SignalLayout(
                "ECHO_STATE", "echo_state",
                start=48, length=2, is_signed=False, scale=1, unit="",
                minimum=0, maximum=1, not_available=None,
            ),
            SignalLayout(
                "ESTIMATE_STATE", "estimate_state",
                start=50, length=2, is_signed=False, scale=1, unit="",
                minimum=0, maximum=2, not_available=None,
            ),
            SignalLayout(
                "CONFIDENCE", "confidence",
                start=52, length=7, is_signed=False, scale=0.01, unit="",
                minimum=0, maximum=1, not_available=None,
            ),
        ),
    ),
    MessageLayout(
        "PLANT_STATUS", can_id=0x310, length=8, cycle_time_ms=100, data_id=0x5310,
        signals=(
            SignalLayout(
                "DOWNLINK_LATENCY", "downlink_latency_s",
                start=24, length=12, is_signed=False, scale=0.0005, unit="s",
                minimum=0, maximum=2.0475, not_available=None,
            ),
            SignalLayout(
                "UPLINK_LATENCY", "uplink_latency_s",
                start=36, length=12, is_signed=False, scale=0.0005, unit="s",
                minimum=0, maximum=2.0475, not_available=None,
            ),
            SignalLayout(
                "PLANT_STATUS_LOST", "lost",
                start=48, length=7, is_signed=False, scale=1, unit="",
                minimum=0, maximum=127, not_available=None,
            ),
            SignalLayout(
                "PLANT_STATUS_REJECTED", "rejected",
                start=55, length=6, is_signed=False, scale=1, unit="",
                minimum=0, maximum=63, not_available=None,
            ),
            SignalLayout(
                "SAFETY", "safety",
                start=61, length=3, is_signed=False, scale=1, unit="",
                minimum=0, maximum=4, not_available=None,
            ),
        ),
    ),
    MessageLayout(
        "LATENCY_CONFIG", can_id=0x320, length=7, cycle_time_ms=0, data_id=None,
        signals=(
            SignalLayout(
                "DIRECTION", "direction",
                start=0, length=2, is_signed=False, scale=1, unit="",
                minimum=1, maximum=3, not_available=None,
            ),
            SignalLayout(
                "MODEL", "model",
                start=4, length=4, is_signed=False, scale=1, unit="",
                minimum=0, maximum=4, not_available=None,
            ),
            SignalLayout(
                "MEAN", "mean_s",
                start=8, length=16, is_signed=False, scale=0.0001, unit="s",
                minimum=0, maximum=6.5535, not_available=None,
            ),
            SignalLayout(
                "SPREAD", "spread_s",
                start=24, length=16, is_signed=False, scale=0.0001, unit="s",
                minimum=0, maximum=6.5535, not_available=None,
            ),
            SignalLayout(
                "LOSS", "loss",
                start=40, length=14, is_signed=False, scale=0.0001, unit="",
                minimum=0, maximum=1, not_available=None,
            ),
        ),
    ),
)
