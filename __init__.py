"""The checkout is the package ``steer_by_wire``: ``dbc/`` is ``steer_by_wire.dbc``, and so on.

Nothing imports this file. It tells a reader of paths that follows no symbolic links, that
``..dbc`` in ``controller/`` is the folder ``dbc/``. What ``import steer_by_wire`` brings is in
``steer_by_wire/__init__.py``.
"""
