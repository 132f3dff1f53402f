"""The moving vehicle: single-track model, actuator, disturbances, and their exact motion.

Not here: which commands reach the actuator (``steering``), and what sensors report (``sensors``).
Begin at ``single_track_model.py`` for the equations, at ``moving_vehicle.py`` for their use.
"""
