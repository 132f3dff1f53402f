"""Five laws side by side in real time while the latency grows, and the same in virtual time.

Not here: starting a pair (``closed_loop.pair.live_pair``). Begin with ``story.py``, which says who
drives what, and judges it.
"""
