"""Feed random bytes to all code that reads bytes, and raise where a promise is broken."""
