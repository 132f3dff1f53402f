"""Speed of the programs on this machine: ``make benchmark``, with pytest-benchmark."""
