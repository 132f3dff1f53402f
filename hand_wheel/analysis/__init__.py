"""Analysis of the feedback loop: the round trips of the bus at which the wheel shakes.

Begin with ``wheel_alone``, which is in closed form.
"""
