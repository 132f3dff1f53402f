"""D-stability: where the roots of a loop have to lie, and the box in which a vehicle is known.

Linear theory that design and the paper's figures compute before any run. What the controller checks
about its own loop is in ``controller.analysis``. Begin with ``d_stability``.
"""
