"""Work that goes on beside a run: a thread that is told when the run has ended."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread


@contextmanager
def going_on(work: Callable[[Event], None]) -> Iterator[None]:
    """`work` in a thread of its own; its event is set, and its end waited for, when the block ends."""
    ended = Event()
    thread = Thread(target=work, args=(ended,), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
