"""All jobs of a plan, by key and by number, in the order in which they were planned: in columns, some 200 bytes a job.

A job itself is kept packed with its neighbours, and unpacked for whoever asks: when it is handed to a worker, and seldom later.
"""

from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from orthomill.pipeline.engine.planned.pickled_jobs import dumps, loads
from orthomill.pipeline.records.numbered_names import Key, NumberedKeys
from orthomill.pipeline.records.packed_list import PackedList
from orthomill.pipeline.records.records import Fingerprint
from orthomill.schemas.job import Export, Job

_DIGEST = 10
"""bytes of a digest, whose text has twice as many"""


@dataclass(frozen=True, slots=True)
class PlannedJob:
    """A job with everything the graph knows about it."""

    job: Job | Export
    dependencies: tuple[Key, ...]
    fingerprint: Fingerprint
    memory: int
    """peak bytes of a worker that runs it"""
    output_bytes: int
    """bytes of the rasters it writes, uncompressed"""
    data_bytes: int
    """bytes of all pixels that it reads and writes, whether or not they are in memory at the same time"""
    key: Key = field(init=False)
    """that of the job: one tuple, which everything that holds keys holds"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "key", self.job.key)


class PlannedJobs(Mapping[Key, PlannedJob]):
    """Grows as jobs are planned. Any thread may ask."""

    def __init__(self) -> None:
        self.keys_by_number = NumberedKeys()
        self._jobs = PackedList(dumps, loads)
        self._digests = bytearray()
        """of settings and of inputs"""
        self._codes, self._code_number, self._code = list[str](), dict[str, int](), array("i")
        self._memory, self._output, self._data = array("q"), array("q"), array("q")
        self._before, self._ends = array("i"), array("q", [0])
        """numbers of the jobs that each waits for, one after the other, and where those of each end"""

    def append(self, planned: PlannedJob, before: Sequence[int]) -> None:
        """Add a job with the numbers of those that it waits for."""
        made_of = planned.fingerprint
        self._jobs.append(planned.job)
        self._digests += bytes.fromhex(made_of.settings) + bytes.fromhex(made_of.inputs)
        if made_of.code not in self._code_number:
            self._code_number[made_of.code] = len(self._codes)
            self._codes.append(made_of.code)
        self._code.append(self._code_number[made_of.code])
        self._memory.append(planned.memory)
        self._output.append(planned.output_bytes)
        self._data.append(planned.data_bytes)
        self._before.extend(before)
        self._ends.append(len(self._before))
        # Last: whoever finds the key, in whatever thread, finds the rest.
        self.keys_by_number.add(planned.key)

    def __len__(self) -> int:
        return len(self.keys_by_number)

    def __iter__(self) -> Iterator[Key]:
        return (self.keys_by_number[number] for number in range(len(self)))

    def __contains__(self, key: object) -> bool:
        return key in self.keys_by_number

    def __getitem__(self, key: Key) -> PlannedJob:
        return self.at(self.number(key))

    def number(self, key: Key) -> int:
        """The number of a job. Raises KeyError."""
        return self.keys_by_number.number(key)

    def at(self, number: int) -> PlannedJob:
        """The job of a number."""
        before = tuple(self.keys_by_number[one] for one in self.before(number))
        sizes = self._memory[number], self._output[number], self._data[number]
        return PlannedJob(self._jobs[number], before, self.fingerprint(number), *sizes)

    def job(self, number: int) -> Job | Export:
        """The job of a number, alone."""
        return self._jobs[number]

    def before(self, number: int) -> Sequence[int]:
        """The numbers of the jobs that a job waits for."""
        return self._before[self._ends[number] : self._ends[number + 1]]

    def fingerprint(self, number: int) -> Fingerprint:
        """That of a job."""
        both = self._digests[2 * _DIGEST * number : 2 * _DIGEST * (number + 1)].hex()
        return Fingerprint(both[: 2 * _DIGEST], self._codes[self._code[number]], both[2 * _DIGEST :])

    def memory(self, number: int) -> int:
        """Peak bytes of a worker that runs a job."""
        return self._memory[number]

    def output_bytes(self, number: int) -> int:
        """Bytes of the rasters that a job writes, not compressed."""
        return self._output[number]


class PendingJobs:
    """Jobs that wait to be handed over, by their numbers."""

    def __init__(self, jobs: PlannedJobs) -> None:
        self._jobs = jobs
        self.clear()

    def clear(self) -> None:
        """None waits."""
        self._numbers, self._first = array("i"), 0
        """and the place of the first that has not been handed over"""
        self.output_bytes = 0
        """of the rasters that they write, not compressed"""
        self._largest = 0

    def __len__(self) -> int:
        return len(self._numbers) - self._first

    def __iter__(self) -> Iterator[PlannedJob]:
        return map(self._jobs.at, self._numbers[self._first :])

    def append(self, number: int) -> None:
        """One more, behind all others."""
        self._numbers.append(number)
        self.output_bytes += self._jobs.output_bytes(number)
        self._largest = max(self._largest, self._jobs.memory(number))

    def popleft(self) -> PlannedJob:
        """The first, which waits no longer."""
        number = self._numbers[self._first]
        self._first += 1
        self.output_bytes -= self._jobs.output_bytes(number)
        if self._first == len(self._numbers):
            self.clear()
        return self._jobs.at(number)

    def first_above(self, room: int) -> PlannedJob | None:
        """The first that needs more memory than this; None where none does."""
        if self._largest <= room:
            return None
        return next((self._jobs.at(one) for one in self._numbers[self._first :] if self._jobs.memory(one) > room), None)
