"""Which job writes each table or file, by path."""

from array import array
from collections.abc import Iterator

from orthomill.pipeline.records.numbered_names import NumberedNames


class FileWriters:
    """Numbers of jobs by path."""

    def __init__(self) -> None:
        self._paths, self._writers = NumberedNames(), array("i")

    def __iter__(self) -> Iterator[str]:
        """All paths, in the order in which they were claimed."""
        return (self._paths[number].decode(errors="surrogateescape") for number in range(len(self._paths)))

    def writer(self, path: str) -> int | None:
        """The job that writes a file; None where none does yet."""
        found = self._paths.find(_bytes_of(path))
        return None if found is None else self._writers[found]

    def claim(self, path: str, number: int) -> int:
        """The job that writes a file: from now on this one, where none did."""
        place = self._paths.add(_bytes_of(path))
        if place == len(self._writers):
            self._writers.append(number)
        return self._writers[place]


def _bytes_of(path: str) -> bytes:
    # Names of files may be no text at all.
    return path.encode(errors="surrogateescape")
