"""The emulated bus as a program.

Not here: the broker itself (``runtime.emulated_bus``). Begin with ``program.py``.
"""
