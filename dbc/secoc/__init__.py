"""Authenticated frames, after AUTOSAR SecOC: a truncated CMAC over content and freshness.

Not here: protection against faults of the bus (``codec.protection``). Begin with
``authentication``.
"""
