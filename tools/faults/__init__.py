"""Faults injected into a live bus, and the program that does so.

Not here: faults in the settings of a run (``plant_emulator.faults``). Begin with
``live_faults.py``: the kinds of faults and how they are written.
"""
