"""The wire contract: ``steer_by_wire.dbc``, and typed messages to and from frames.

Not here: what a node does with a message. Begin with ``messages``; the DBC is the source of all.
"""
