"""The command line of the controller: its options, and what ``--fail-if`` reads from its report.

The node itself, which opens no bus, is ``controller.node``. Begin with ``program.py``.
"""
