"""The pair over the load, the bit error rate and the clocks of its bus."""
