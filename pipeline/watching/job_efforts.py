"""Family and effort of every job of a run: some 40 bytes each."""

from array import array

from orthomill.pipeline.forecast.known_costs import Family
from orthomill.pipeline.records.numbered_names import Key, NumberedKeys


class JobEfforts:
    """By the key of the job."""

    def __init__(self) -> None:
        self._keys, self._family, self._effort = NumberedKeys(), array("i"), array("d")
        self._numbers: dict[Family, int] = {}
        self._families: list[Family] = []

    def add(self, key: Key, family: Family, effort: float) -> None:
        """One more job."""
        if family not in self._numbers:
            self._numbers[family] = len(self._families)
            self._families.append(family)
        if self._keys.add(key) == len(self._family):
            self._family.append(self._numbers[family])
            self._effort.append(effort)

    def __getitem__(self, key: Key) -> tuple[Family, float]:
        number = self._keys.number(key)
        return self._families[self._family[number]], self._effort[number]
