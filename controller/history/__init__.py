"""What was sent and measured so far, by tick and sample, for laws that look back."""
