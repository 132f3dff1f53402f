"""Records the frames of a program to a file, off the control path; begin at `recording.py`."""
