"""Check what this machine has for CAN."""
