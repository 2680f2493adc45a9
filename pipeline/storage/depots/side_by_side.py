"""Several requests to a store on their way at a time: most of a request's time is waiting for its answer."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from itertools import islice
from threading import local
from typing import TypeVar

from orthomill.pipeline.storage.depots.depot import Depot

A = TypeVar("A")
B = TypeVar("B")
_OF_THREAD = local()


def _begin(level: int) -> None:
    _OF_THREAD.level = level


_POOLS = tuple(ThreadPoolExecutor(threads, "requests", _begin, (level + 1,)) for level, threads in enumerate((8, 32)))
"""Threads that stay from one reading to the next: to start eight takes longer than to read a chunk. Regions are read by those of
the first pool, their chunks by those of the second: whoever waited for others of its own pool would wait for itself."""


def side_by_side(depot: Depot, read: Callable[[A], B], items: Iterable[A]) -> Iterator[B]:
    """What `read` gives for each item, in their order; no more of them wait to be taken than the depot answers at a time.

    The error of the first item that has one is raised where its value would come.
    """
    waiting, level = list(items), getattr(_OF_THREAD, "level", 0)
    if min(depot.at_once, len(waiting)) < 2 or level == len(_POOLS):
        yield from map(read, waiting)
        return
    rest, pool = iter(waiting), _POOLS[level]
    ahead: deque[Future[B]] = deque(pool.submit(read, one) for one in islice(rest, depot.at_once))
    try:
        while ahead:
            value = ahead.popleft().result()
            ahead.extend(pool.submit(read, one) for one in islice(rest, 1))
            yield value
    finally:
        for left in ahead:
            left.cancel()
        wait(ahead)
