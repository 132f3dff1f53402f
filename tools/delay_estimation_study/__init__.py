"""How well the delay is known without an echo."""
