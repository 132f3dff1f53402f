"""How fast the programs are on this machine: ``make benchmark``, with pytest-benchmark."""
