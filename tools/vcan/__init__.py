"""A real vcan0 on any Linux machine, for ``steer-by-wire with-vcan``.

Admission rule: nothing but the standard library, and no other package of ours.
"""
