"""A vehicle with which each stretch of stable delays is wide enough for runs to show its ends.

``MODEL`` is for the controller's settings, ``PLANT`` for those of the plant.
"""

_VALUES = ("front_cornering_stiffness_n_rad=195000", "preview_distance_m=1.912")
MODEL = tuple(f"nominal_model.{value}" for value in _VALUES)
PLANT = tuple(f"vehicle.{value}" for value in _VALUES)
