"""Any program as the controller in virtual time: it waits for the plant, and the plant for it.

Not here: programs on a bus in real time (``closed_loop.pair.live_pair``).
Begin at ``lockstep.h``, which describes the one record that travels both ways.
"""
