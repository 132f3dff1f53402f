"""Design gains and filters for a vehicle known within bounds; see docs/design_gains.md."""
