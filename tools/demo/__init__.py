"""Three laws side by side in real time."""
