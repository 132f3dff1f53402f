"""Any program or library as the controller in virtual time: each waits for the other.

Not here: programs on a bus in real time (``closed_loop.pair.live_pair``).
Begin at ``lockstep.h``, which describes the one record that travels both ways.
"""
