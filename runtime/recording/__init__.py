"""Recording of the frames of a program to a file, off the control path.

Not here: what recordings say (``closed_loop/recordings``).
Begin at ``recording.py``.
"""
