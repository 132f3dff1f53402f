"""Both nodes together: in virtual time, as processes on a bus, compiled; begin at `simulate.py`.

In the rooms: compiled runs, recordings, studies, a rig for any controller, the parameter space and
reports. Admission rule: it needs both nodes, or what they leave, and two programs use it.
"""
