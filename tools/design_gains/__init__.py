"""Gains and filters for a vehicle that is known within bounds; see docs/design_gains.md."""
