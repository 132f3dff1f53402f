"""A real vcan0 on any Linux machine: the command ``with-vcan``, also installed by itself.

Nothing but the standard library of Python 3.10, and no other package of ours: a contract of the
import linter. Begin with ``backend_choice.py``; its three ways are ``host``, ``namespace`` and
``uml``.
"""
