"""Standard tests of a car without a driver: programs of steering, scored as the standards do.

Begin at ``steer_programs.py``; ``scores.py`` computes the figures.
"""
