"""The emulated bus as a program."""
