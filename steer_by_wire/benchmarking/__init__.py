"""How a benchmark measures and prints: medians, ratios, tables.

Admission rule: two benchmarks use it, and it times nothing of ours by name.
"""
