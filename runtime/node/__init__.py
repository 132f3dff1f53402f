"""What a node is (`node.py`), and the executors that run nodes in virtual and in real time."""
