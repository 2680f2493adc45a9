"""Ctrl-C, and the polite stop of a batch system: both end a run with KeyboardInterrupt.

Python drops an exception that arrives inside a finaliser or a callback, so the wish to stop is kept as well, and whoever loops for
long looks at it.
"""

import signal
from threading import Event
from types import FrameType

_WISH = Event()


def listen() -> None:
    """From now on SIGINT and SIGTERM raise KeyboardInterrupt, once at once and then wherever `stop_if_asked` is called."""
    _WISH.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> None:
    _WISH.set()
    raise KeyboardInterrupt


def stop_if_asked() -> None:
    """Raises KeyboardInterrupt when a stop was asked for and may have been lost."""
    if _WISH.is_set():
        raise KeyboardInterrupt
