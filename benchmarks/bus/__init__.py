"""What the controller on a bus costs, beside C and bare Python.

Not here: the loop without a bus (``benchmarks.loop``). Begin with ``benchmark.py``.
"""
