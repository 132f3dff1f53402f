"""The command line of the plant emulator: its options, ``--check`` and what ``--fail-if`` reads.

The node itself, which opens no bus, is ``plant_emulator.node``. Begin with ``program.py``.
"""
