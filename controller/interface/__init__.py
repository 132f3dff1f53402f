"""What every law shares: its input, output and record, limits, fades and designed ranges.

Not here: a law (``laws``), or who runs it (``node``). Begin with ``law``.
"""
