"""Packs, unpacks and protects the payload of one message, from its layout alone.

Not here: which messages there are (``contract``). Begin with ``codec``.
"""
