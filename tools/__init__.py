"""The programs, each in a folder of its own; none imports another.

What two programs share is in ``closed_loop``; ``steer_by_wire/command.py`` lists the commands.
"""
