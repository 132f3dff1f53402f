"""What things cost on this machine: the parts of the programs ``tools.benchmark*``."""
