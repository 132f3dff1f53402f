"""Run four laws side by side in real time while the latency grows."""
