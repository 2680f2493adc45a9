"""Several requests to a store on their way at a time: most of a request's time is waiting for its answer."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

from orthomill.pipeline.storage.depots.depot import Depot

A = TypeVar("A")
B = TypeVar("B")


def side_by_side(depot: Depot, read: Callable[[A], B], items: Iterable[A]) -> Iterator[B]:
    """What `read` gives for each item, in their order; no more of them wait to be taken than the depot answers at a time.

    The error of the first item that has one is raised where its value would come.
    """
    waiting = list(items)
    if min(depot.at_once, len(waiting)) < 2:
        yield from map(read, waiting)
        return
    rest = iter(waiting)
    with ThreadPoolExecutor(min(depot.at_once, len(waiting))) as pool:
        ahead: deque[Future[B]] = deque(pool.submit(read, one) for one in islice(rest, depot.at_once))
        try:
            while ahead:
                value = ahead.popleft().result()
                ahead.extend(pool.submit(read, one) for one in islice(rest, 1))
                yield value
        finally:
            pool.shutdown(cancel_futures=True)
