"""Compute the figures and tables of SAE 2018-01-1086 with this project's models and laws."""
