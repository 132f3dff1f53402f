"""Time that a fault may last before the car leaves its lane.

Begin at ``longest_time.py``; ``settings.py`` is the study's file.
"""
