"""The car: a single track with tyres that saturate and lag, and with speed as a state.

Begin at ``car_step.py`` for the equations, at ``car_motion.py`` for their use.
"""
