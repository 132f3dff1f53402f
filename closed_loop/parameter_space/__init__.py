"""Theory of the loop beyond ``--check``: what design and reproduction compute before any run.

Admission rule: linear theory of the closed loop that the controller program never imports.
"""
