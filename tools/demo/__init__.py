"""Run three laws side by side in real time."""
