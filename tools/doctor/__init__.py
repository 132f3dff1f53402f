"""What this machine has for CAN and real time, and which rate it can keep.

Nothing here runs a plant or a controller on a bus. Begin with ``checks.py``; what is measured is in
``measurement.py``, the rule for a rate that is kept in ``kept_rate.py``.
"""
