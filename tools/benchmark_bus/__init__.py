"""What the benchmark on a real CAN interface measures with, and what it compares with.

The C programs and the bare Python echo do only what is necessary, and serve as references.
"""
