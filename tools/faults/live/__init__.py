"""The live part of the fault campaign: real processes on an emulated bus, one fault at a time."""
