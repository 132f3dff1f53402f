"""Find out how well the delay is estimated without an echo."""
