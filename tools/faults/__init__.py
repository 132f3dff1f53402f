"""Faults: a campaign in virtual time, the same on real processes, faults on a live bus by hand.

Here are what is injected, how runs are judged, and two programs; the stage that changes frames at
the plant's edge is in ``plant_emulator.faults``. Begin with ``program.py``, the campaign.
"""
