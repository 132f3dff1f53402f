"""Bounds of a command under any law: angle and rate, fades, the ranges the design is for.

Not here: the limits of the plant's steering unit (``plant_emulator.steering``). Begin with
``steer_limits``.
"""
