"""Where an installation from before this module became ``interface`` looks for the interface."""

from .interface import EmulatedBus as EmulatedBus
