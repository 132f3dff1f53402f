"""Stress studies: thousands of scenarios of network, vehicle and law, and what becomes of each."""
