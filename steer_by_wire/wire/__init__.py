"""CAN frames bit by bit, as an oscilloscope shows them; for programs and tests, not for the loop.

Admission rule: it says which bits are on the wire or what follows from them, with frames alone.
The loop needs only lengths, and has them from ``runtime.frame_length``.
"""
