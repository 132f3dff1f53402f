"""What is recorded of a run, and what is concluded from it."""
