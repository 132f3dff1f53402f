"""Plant emulator and controller together: live or in virtual time, their bus, what they leave.

Begin at `virtual_pair.py`.
"""
