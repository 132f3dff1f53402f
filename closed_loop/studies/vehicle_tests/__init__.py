"""Standard tests of a car without a driver: programs of steering, scored as the standards do.

Begin at ``scores.py``, which drives the tests and computes the figures.
"""
