"""History of commands and measurements, by tick and sample, for laws that look back.

Not here: the delay that the controller reports (``node.reported_delay``). Begin with ``history``.
"""
