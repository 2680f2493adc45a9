"""What became of every planned job, and why it runs: a byte each."""

from collections.abc import Iterable, Iterator, MutableMapping, MutableSet
from enum import IntEnum

import numpy as np

from orthomill.pipeline.records.numbered_names import Key, NumberedKeys


class JobState(IntEnum):
    """The state of a job."""

    TO_DO = 0
    SKIPPED = 1
    """its results of an earlier run are kept"""
    DONE = 2
    BLOCKED = 3
    FAILED = 4


VALID = (JobState.SKIPPED, JobState.DONE)


class JobStates:
    """The states of the jobs of a plan, by number: those that are not told of are to be done."""

    def __init__(self, keys: NumberedKeys) -> None:
        self.keys = keys
        self._states = bytearray()

    def __getitem__(self, number: int) -> int:
        return self._states[number] if number < len(self._states) else JobState.TO_DO

    def __setitem__(self, number: int, state: JobState) -> None:
        if number >= len(self._states):
            self._states.extend(bytes(max(len(self.keys), number + 1) - len(self._states)))
        self._states[number] = state

    def is_valid(self, number: int) -> bool:
        """Whether the results of a job are there and describe the project as it is."""
        return self[number] in VALID

    def counts(self, stage: str) -> list[int]:
        """How many jobs of a stage are in each state."""
        states = np.frombuffer(bytes(self._states) + bytes(len(self.keys) - len(self._states)), np.uint8)
        return np.bincount(states[self.keys.of_stage(stage)], minlength=len(JobState)).tolist()

    def clear(self, state: JobState) -> None:
        """All jobs in a state are to be done."""
        self._states = self._states.replace(bytes([state]), bytes([JobState.TO_DO]))

    def numbers(self, state: JobState) -> Iterator[int]:
        """The jobs in a state."""
        number = self._states.find(state)
        while number >= 0:
            yield number
            number = self._states.find(state, number + 1)


class KeysIn(MutableSet[Key]):
    """The keys of the jobs in one state."""

    def __init__(self, states: JobStates, state: JobState) -> None:
        self._states, self._state = states, state

    def __contains__(self, key: object) -> bool:
        number = self._states.keys.find(key) if isinstance(key, tuple) else None
        return number is not None and self._states[number] == self._state

    def __iter__(self) -> Iterator[Key]:
        return (self._states.keys[number] for number in self._states.numbers(self._state))

    def __len__(self) -> int:
        return sum(1 for _ in self._states.numbers(self._state))

    def __bool__(self) -> bool:
        return next(self._states.numbers(self._state), None) is not None

    def __repr__(self) -> str:
        return repr(set(self))

    @classmethod
    def _from_iterable(cls, keys: Iterable[Key]) -> set[Key]:  # type: ignore[override]
        return set(keys)

    def add(self, key: Key) -> None:
        """The job is in this state from now on, and in no other."""
        self._states[self._states.keys.number(key)] = self._state

    def discard(self, key: Key) -> None:
        """The job is to be done, if it was in this state."""
        if key in self:
            self._states[self._states.keys.number(key)] = JobState.TO_DO


class Reasons(MutableMapping[Key, str]):
    """Why jobs run, by key. There are few different reasons."""

    def __init__(self, keys: NumberedKeys) -> None:
        self._keys, self._texts, self._reasons = keys, [""], bytearray()

    def __getitem__(self, key: Key) -> str:
        number = self._keys.number(key)
        if not (number < len(self._reasons) and self._reasons[number]):
            raise KeyError(key)
        return self._texts[self._reasons[number]]

    def __setitem__(self, key: Key, reason: str) -> None:
        number = self._keys.number(key)
        if number >= len(self._reasons):
            self._reasons.extend(bytes(len(self._keys) - len(self._reasons)))
        if reason not in self._texts:
            self._texts.append(reason)
        self._reasons[number] = self._texts.index(reason)

    def at(self, number: int) -> str:
        """That of the job of a number, which has one."""
        return self._texts[self._reasons[number]]

    def __delitem__(self, key: Key) -> None:
        self[key] = ""

    def __iter__(self) -> Iterator[Key]:
        return (self._keys[number] for number, reason in enumerate(self._reasons) if reason)

    def __len__(self) -> int:
        return sum(map(bool, self._reasons))
