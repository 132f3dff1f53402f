"""What follows from the bits and times of frames: waveforms, longest frames, response times.

Admission rule: it computes from frames and message sets alone, and no node needs it while it runs.
The bits themselves are in ``runtime.frame_on_wire``, since the bus model needs them for errors.
"""
