"""Show the bus in a terminal, and change the latency with keys."""
