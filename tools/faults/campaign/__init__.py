"""The campaign in virtual time: what is tried, what is seen, and what detected it."""
