"""Run both nodes in one process, in virtual time or in real time."""
