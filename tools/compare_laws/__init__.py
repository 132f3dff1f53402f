"""Compare every law over delay, jitter, loss and lag, and find where each breaks."""
