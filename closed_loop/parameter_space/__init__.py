"""D-stability: where the roots of a loop have to lie, and the gains that bring them there.

Linear theory that design and the paper's figures compute before any run. What the controller checks
about its own loop is in ``controller.analysis``. Begin with ``d_stability``.
"""
