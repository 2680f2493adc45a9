"""A long list whose elements are kept packed, block by block: thousands of jobs or records are alike, and few are looked at."""

import zlib
from collections import OrderedDict
from collections.abc import Callable, Iterator
from threading import RLock
from typing import Generic, TypeVar

T = TypeVar("T")
BLOCK = 256
"""elements that are packed together"""
UNPACKED = 16
"""blocks that are kept as they were asked for last: who walks through the list, or nearly in its order, unpacks each once"""


class PackedList(Generic[T]):
    """A list that grows at its end. `dumps` and `loads` turn some elements into bytes and back; where `dumps` refuses they stay as
    they are. Any thread may ask."""

    def __init__(self, dumps: Callable[[list[T]], bytes], loads: Callable[[bytes], list[T]]) -> None:
        self._dumps, self._loads = dumps, loads
        self._blocks: list[bytes | list[T]] = []
        self._last: list[T] = []
        self._unpacked: OrderedDict[int, list[T]] = OrderedDict()
        self._lock = RLock()

    def __len__(self) -> int:
        return BLOCK * len(self._blocks) + len(self._last)

    def __getitem__(self, number: int) -> T:
        with self._lock:
            block, place = divmod(number, BLOCK)
            return (self._block(block) if block < len(self._blocks) else self._last)[place]

    def __iter__(self) -> Iterator[T]:
        return (self[number] for number in range(len(self)))

    def append(self, element: T) -> None:
        """Add one more."""
        with self._lock:
            self._last.append(element)
            if len(self._last) == BLOCK:
                self._blocks.append(self._packed(self._last))
                self._last = []

    def _packed(self, elements: list[T]) -> bytes | list[T]:
        try:
            return zlib.compress(self._dumps(elements), 1)
        except Exception:  # what cannot be pickled says so in its own way; a run in one process needs it as it is
            return elements

    def _block(self, number: int) -> list[T]:
        held = self._blocks[number]
        if isinstance(held, list):
            return held
        if number not in self._unpacked:
            self._unpacked[number] = self._loads(zlib.decompress(held))
            if len(self._unpacked) > UNPACKED:
                self._unpacked.popitem(last=False)
        return self._unpacked[number]
