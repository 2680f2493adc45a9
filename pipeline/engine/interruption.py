"""Ctrl-C, and the SIGTERM of a batch system: both end a run with KeyboardInterrupt.

Python drops an exception that is raised inside a finaliser or a callback. The request to stop is therefore kept as well, and long
loops check it.
"""

import signal
from threading import Event
from types import FrameType

_STOP_REQUESTED = Event()


def listen() -> None:
    """From now on SIGINT and SIGTERM raise KeyboardInterrupt, immediately and then wherever `stop_if_asked` is called."""
    _STOP_REQUESTED.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> None:
    _STOP_REQUESTED.set()
    raise KeyboardInterrupt


def stop_if_asked() -> None:
    """Raises KeyboardInterrupt when a stop was requested and the exception may have been lost."""
    if _STOP_REQUESTED.is_set():
        raise KeyboardInterrupt
