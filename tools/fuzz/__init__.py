"""Fuzz targets: each takes any bytes and raises where the project breaks a promise."""
