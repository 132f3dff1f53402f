"""Parts of the feedback loop for its analysis: the wheel alone, the road, and laws, sampled.

Begin with ``wheel_alone``, in closed form; ``closed_loop.scripting`` closes the loop.
"""
