"""Compiled runs: the step functions of controller and plant, bit for bit as in virtual time."""
