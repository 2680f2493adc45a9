"""Ctrl-C, and the SIGTERM of a batch system: both end a run with KeyboardInterrupt.

Python drops an exception that is raised inside a finaliser or a callback. The request to stop is therefore kept as well, and long
loops check it. Where an exception in the middle would break what it meets, as in Dask's connections, only the loops act on it.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from types import FrameType

_STOP_REQUESTED = Event()
_HELD_BACK = Event()


def listen() -> None:
    """From now on SIGINT and SIGTERM raise KeyboardInterrupt, immediately and then wherever `stop_if_asked` is called."""
    _STOP_REQUESTED.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)


@contextmanager
def only_where_asked() -> Iterator[None]:
    """Inside, a request to stop raises in `stop_if_asked` and nowhere else; a second one, of an impatient user, raises at once."""
    _HELD_BACK.set()
    try:
        yield
    finally:
        _HELD_BACK.clear()


def _stop(number: int, frame: FrameType | None) -> None:
    again = _STOP_REQUESTED.is_set()
    _STOP_REQUESTED.set()
    if again or not _HELD_BACK.is_set():
        raise KeyboardInterrupt


def stop_if_asked() -> None:
    """Raises KeyboardInterrupt when a stop was requested and the exception was held back or may have been lost."""
    if _STOP_REQUESTED.is_set():
        raise KeyboardInterrupt
