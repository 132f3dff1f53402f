"""The unit under test: steering laws, filters, prediction, supervision, node and program.

Not here: the vehicle it steers (``plant_emulator``), and both together (``closed_loop``). Begin
with ``node.node``.
"""
