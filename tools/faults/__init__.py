"""Faults: a campaign in virtual time, faults on a live bus by hand, and soaks of real processes.

Here are what is injected, how runs are judged, and three programs; the stage that changes frames at
the plant's edge is in ``plant_emulator.faults``. Begin with ``program.py``, the campaign.
"""
