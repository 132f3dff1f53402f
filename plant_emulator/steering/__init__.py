"""All that stands between a received command and the actuator.

Not here: the actuator (``vehicle``), and whether a frame is valid (``dbc.reception``).
Begin at ``control_unit.py``; its rules are ``hold_and_fallback.py`` and ``steer_limits.py``.
"""
