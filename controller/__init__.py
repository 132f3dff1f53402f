"""The unit under test: steering control laws, observers, modes, design, node and program."""
