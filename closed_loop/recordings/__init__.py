"""Reads logs of a bus: any format in, signals and figures out.

Admission rule: it reads frames that were on a bus; it draws and writes nothing.
"""
