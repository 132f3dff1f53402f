"""The state of a bus from its frames: newest signals, latency, cycle times, refused frames.

Admission rule: it is what a live view of a bus shows, it draws nothing, and two programs use it.
"""
