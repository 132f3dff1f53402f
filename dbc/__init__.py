"""The wire contract: ``steer_by_wire.dbc`` and typed messages to and from frames."""
