"""Analyse a recording or a candump log: signals, latencies, losses.

Not here: how a log is read and judged (``closed_loop.recordings``). Begin with ``__main__.py``;
``report.py`` writes the page.
"""
