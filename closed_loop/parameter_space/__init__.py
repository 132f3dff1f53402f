"""The parameter space method: the gains with which a family of loops is D-stable.

Linear theory that design and the paper's figures compute before any run. What the controller checks
about its own loop is in ``controller.analysis``. Begin with ``gain_regions``.
"""
