"""The controller on a bus, beside C and bare Python; begin with ``benchmark.py``."""
