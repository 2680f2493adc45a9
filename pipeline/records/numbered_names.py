"""Names and keys of jobs by number, in the order in which they came: some 25 bytes a key, where a dictionary takes 250.

A table of numbers is looked through from the place that the hash of a name tells (open addressing); the names themselves lie one
after the other in one array of bytes.
"""

from array import array
from collections.abc import Sequence
from struct import Struct, error
from typing import overload

import numpy as np

Key = tuple[str, str, int, int]
"""(stage, item, row, column) of a job"""
_FREE = -1
_PLACE = Struct("<iii")
"""number of the stage and item, row, column"""


class NumberedNames:
    """Byte strings, each of which has a number. One thread adds them; any may ask."""

    def __init__(self) -> None:
        self._slots = array("i", [_FREE]) * 8
        self._ends = array("I", [0])
        """where each ends among the bytes of all"""
        self.joined = bytearray()
        """all, one after the other"""

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, number: int) -> bytes:
        return bytes(self.joined[self._ends[number] : self._ends[number + 1]])

    def find(self, name: bytes) -> int | None:
        """The number of a name; None where it has none."""
        # Asked once: another thread may enlarge it meanwhile.
        slots = self._slots
        number = slots[self._slot(slots, name)]
        return None if number == _FREE else number

    def add(self, name: bytes) -> int:
        """The number of a name, a new one where it has none."""
        slot = self._slot(self._slots, name)
        if self._slots[slot] != _FREE:
            return self._slots[slot]
        number = len(self)
        self.joined += name
        self._ends.append(len(self.joined))
        # Last: who finds the number finds the name.
        self._slots[slot] = number
        if 3 * number > 2 * len(self._slots):
            self._enlarge()
        return number

    def _slot(self, slots: array, name: bytes) -> int:
        """Where the number of a name is, or would be."""
        ends, held, last = self._ends, self.joined, len(slots) - 1
        slot = hash(name) & last
        while (number := slots[slot]) != _FREE and held[ends[number] : ends[number + 1]] != name:
            slot = (slot + 1) & last
        return slot

    def _enlarge(self) -> None:
        slots = array("i", [_FREE]) * (2 * len(self._slots))
        last = len(slots) - 1
        for number in range(len(self)):
            slot = hash(self[number]) & last
            while slots[slot] != _FREE:
                slot = (slot + 1) & last
            slots[slot] = number
        # Whole at once: other threads look names up in it.
        self._slots = slots


class NumberedKeys(Sequence[Key]):
    """Keys of jobs, each of which has a number."""

    def __init__(self) -> None:
        self._kinds: dict[tuple[str, str], int] = {}
        """stages with items: tiles have few between them"""
        self._named: list[tuple[str, str]] = []
        self._places = NumberedNames()

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, number: int) -> Key: ...

    @overload
    def __getitem__(self, number: slice) -> list[Key]: ...

    def __getitem__(self, number: int | slice) -> Key | list[Key]:
        if isinstance(number, slice):
            return [self[one] for one in range(len(self))[number]]
        try:
            kind, row, col = _PLACE.unpack_from(self._places.joined, _PLACE.size * number)
        except error:  # whoever walks through a sequence goes on to its end
            raise IndexError(number) from None
        stage, item = self._named[kind]
        return stage, item, row, col

    def __contains__(self, key: object) -> bool:
        return isinstance(key, tuple) and self.find(key) is not None

    def find(self, key: Key) -> int | None:
        """The number of a key; None where it has none."""
        stage, item, row, col = key
        kind = self._kinds.get((stage, item))
        return None if kind is None else self._places.find(_PLACE.pack(kind, row, col))

    def number(self, key: Key) -> int:
        """The number of a key that has one. Raises KeyError."""
        if (found := self.find(key)) is None:
            raise KeyError(key)
        return found

    def of_stage(self, stage: str) -> np.ndarray:
        """The numbers of the keys of a stage."""
        kinds = np.frombuffer(bytes(self._places.joined), np.dtype("<i4")).reshape(-1, _PLACE.size // 4)[:, 0]
        return np.flatnonzero(np.isin(kinds, [number for number, named in enumerate(self._named) if named[0] == stage]))

    def add(self, key: Key) -> int:
        """The number of a key, a new one where it has none."""
        stage, item, row, col = key
        kind = self._kinds.get((stage, item))
        if kind is None:
            kind = self._kinds[stage, item] = len(self._named)
            self._named.append((stage, item))
        return self._places.add(_PLACE.pack(kind, row, col))
