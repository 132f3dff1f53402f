"""What this machine has for CAN."""
