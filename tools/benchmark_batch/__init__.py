"""Compare the speed of compiled runs with plain C of the same arithmetic and other tools."""
