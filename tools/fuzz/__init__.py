"""Feed any bytes to everything that reads, and raise where a promise is broken."""
