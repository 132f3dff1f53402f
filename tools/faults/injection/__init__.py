"""What is injected into a live bus and live processes, and the program that does so by hand.

Whether somebody notices is judged in ``campaign`` and ``live``. Begin with ``live_faults.py``: the
kinds of faults and how they are written.
"""
