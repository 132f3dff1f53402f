"""Means of this machine for CAN and real time.

Nothing here runs a plant or a controller on a bus. Begin with ``checks.py``.
"""
