"""The messages: a typed record for each, its enumerations, and the layout generated from the DBC.

Not here: frames (``messages``). Begin with ``records``; after a change of the DBC run
``layout_from_dbc``.
"""
