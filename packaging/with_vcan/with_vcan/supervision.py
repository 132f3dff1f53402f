"""Supervision of the command while it runs: pass signals on, watch the time."""

import os
import selectors
import signal
import time
from collections.abc import Callable

from .guard import Guard, exit_status
from .system_calls import Signal, read_signal, signal_descriptor

PASSED_ON = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGWINCH)
TIMEOUT_STATUS = 124
"""As with timeout(1)."""
GRACE_S = 5.0
"""How long the command may take to end after SIGTERM."""


def block_signals() -> None:
    """Block the signals that are passed on, so the wrapper survives; before ``start_guard``."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (*PASSED_ON, signal.SIGCHLD))


def supervise(
    guard: Guard,
    timeout_s: float | None,
    pass_on: Callable[[Signal], None],
    relay: selectors.BaseSelector | None = None,
) -> int:
    """Wait until the guard ends; returns its exit status, or TIMEOUT_STATUS.

    ``timeout_s``  after which the command gets SIGTERM, and is killed if it does not end
    ``pass_on``    sends a signal to the command
    ``relay``      further descriptors to watch; their data are functions without arguments to call
    """
    signals = signal_descriptor((*PASSED_ON, signal.SIGCHLD))
    selector = relay or selectors.DefaultSelector()
    selector.register(signals, selectors.EVENT_READ, None)
    deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
    timed_out = False
    while True:
        wait_s = None if deadline_s is None else max(deadline_s - time.monotonic(), 0.0)
        for key, _ in selector.select(wait_s):
            if key.data is not None:
                key.data()
                continue
            arrived = read_signal(signals)
            if arrived.number != signal.SIGCHLD:
                pass_on(arrived)
                continue
            pid, status = os.waitpid(guard.pid, os.WNOHANG)
            if pid:
                return TIMEOUT_STATUS if timed_out else exit_status(status)
        if deadline_s is not None and time.monotonic() >= deadline_s:
            if timed_out:
                guard.end()
                deadline_s = None
            else:
                timed_out = True
                pass_on(Signal(signal.SIGTERM, False))
                deadline_s += GRACE_S
