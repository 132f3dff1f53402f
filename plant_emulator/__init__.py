"""The plant: vehicle on a path, actuator, sensors, network, the steering's safety, and the program.

Not here: the controller, which is never imported, and runs of both together (``closed_loop``).
Begin at ``node/node.py``; ``settings.py`` has the tables of all rooms in one model.
"""
