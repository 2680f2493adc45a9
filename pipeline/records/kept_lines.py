"""The lines of records that count, by job: some 200 bytes each, for a project of a million jobs has as many."""

from array import array
from collections.abc import Iterator, Mapping

from orthomill.pipeline.records.numbered_names import NumberedKeys
from orthomill.pipeline.records.packed_list import PackedList
from orthomill.pipeline.records.record_lines import Place, RecordLine

_END = b"\n"
"""The JSON of a record has none."""


class KeptLines(Mapping[Place, RecordLine]):
    """Of two lines about the same job the larger one is kept. What they say is packed until somebody asks."""

    def __init__(self) -> None:
        self._keys = NumberedKeys()
        self._wave, self._rank, self._started = array("i"), bytearray(), array("d")
        self._text, self._texts = array("i"), PackedList(_END.join, lambda content: content.split(_END))
        """which of the texts is that of a job: those that count no longer stay where they are"""

    def __len__(self) -> int:
        return len(self._text)

    def __iter__(self) -> Iterator[Place]:
        return (key[1:] for key in self._keys)

    def __contains__(self, place: object) -> bool:
        return isinstance(place, tuple) and ("", *place) in self._keys

    def __getitem__(self, place: Place) -> RecordLine:
        number = self._keys.number(("", *place))
        return RecordLine(*self._head(number), self._texts[self._text[number]])

    def get(self, place: Place, default: RecordLine | None = None) -> RecordLine | None:  # type: ignore[override]
        """The line of a job; None where there is none."""
        return default if self._keys.find(("", *place)) is None else self[place]

    def _head(self, number: int) -> tuple[int, int, float]:
        return self._wave[number], self._rank[number], self._started[number]

    def keep(self, place: Place, line: RecordLine) -> None:
        """A line that was read: it counts unless a larger one does."""
        number = self._keys.find(("", *place))
        if number is None:
            self._wave.append(line.wave)
            self._rank.append(line.rank)
            self._started.append(line.started)
            self._text.append(len(self._texts))
            self._texts.append(line.text)
            # Last: another thread that finds the place finds the rest.
            self._keys.add(("", *place))
        elif self._head(number) <= line[:3]:
            self._wave[number], self._rank[number], self._started[number] = line[:3]
            self._text[number] = len(self._texts)
            self._texts.append(line.text)
