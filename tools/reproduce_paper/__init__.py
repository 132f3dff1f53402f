"""The figures and tables of SAE 2018-01-1086, computed from this project's models and laws."""
