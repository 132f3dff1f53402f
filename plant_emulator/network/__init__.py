"""Latency and loss between the nodes: distributions, draws, and the two lines that delay frames."""
