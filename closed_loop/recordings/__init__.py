"""What the frames on a bus say, from a log of any format or live: signals, latency and figures.

Not here: drawing, and recording (`live_bus.py`, `runtime/recording`). Begin at `log_analysis.py`.
"""
