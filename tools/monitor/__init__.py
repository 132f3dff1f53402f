"""Show the bus in a terminal.

Not here: what the frames say (``closed_loop.recordings.live_view``). Begin with ``screen.py``.
"""
