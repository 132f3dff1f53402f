"""Frames on a bus in words and figures, from a log of any format or live.

Not here: drawing, and recording (``runtime.recording``). Begin at ``log_analysis.py``.
"""
