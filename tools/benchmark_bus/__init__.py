"""What the benchmark on a real CAN interface measures with, and what it compares with.

The C programs and the bare Python echo are the yardsticks: they do the least that can be done.
"""
