"""Five laws side by side in real time while the latency grows, and the same in virtual time.

Not here: starting a pair (``closed_loop.pair.live_pair``). Begin with ``laws_and_phases.py``,
which says who drives what, and judges it.
"""
