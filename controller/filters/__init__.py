"""The paper's filters: PD, DOB, CDOB, the nominal model, and how they become discrete.

Not here: how a law combines them (``laws``). Begin with ``sections``, of which all consist.
"""
