"""The delay from command and response, without an echo; reported on the bus, used by no law.

Not here: the delay measured by echoes (``history.echo_delay``). Begin with ``delay_estimator``.
"""
