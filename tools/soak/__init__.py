"""Run the pair for minutes on a bus that a babbling node keeps full."""
