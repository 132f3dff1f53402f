"""The vehicle's state at the time at which a command will act, and the gains for it.

Not here: when a law uses it (``laws.predictor``). Begin with ``vehicle_kalman_filter``, then
``prediction``.
"""
