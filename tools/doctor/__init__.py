"""Means of this machine for CAN and real time, and the rate that it can keep.

Nothing here runs a plant or a controller on a bus. Begin with ``checks.py``; ``kept_rate.py``
measures, and has the rule for a rate that is kept.
"""
