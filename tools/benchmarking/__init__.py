"""How a benchmark measures and prints: medians, ratios, tables.

Admission rule: two benchmarks use it, and it names no part of this project that it times.
"""
