"""Both nodes together: in virtual time, as processes on a bus, compiled; begin at `simulate.py`.

Not here: what one node or one program alone uses. The rooms hold compiled runs, recordings,
studies, a rig for any controller, the parameter space and reports.
"""
