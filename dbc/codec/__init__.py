"""Packs, unpacks and protects the payload of one message, from its layout alone."""
