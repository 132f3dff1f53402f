"""Run both nodes in one process, in virtual time or in real time.

Not here: the same from Python (``closed_loop.scripting.simulate``). Begin with ``result.py``.
"""
