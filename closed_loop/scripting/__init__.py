"""The functions that scripts and notebooks call: one simulated run, and the analysis of a loop.

Begin at `simulate.py`.
"""
