"""Three ways to a real ``vcan0``: the host's own, a private network namespace, User Mode Linux.

Standard library only: ``tools/with_vcan`` works before anything is installed.
"""
