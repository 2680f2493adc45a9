"""Which tests are left out by `make test-fast`: measured, not guessed. `make test-times` runs all and writes tests/slow_tests.txt.

A test costs the processor time of its setup and its call, processes that it starts included. The cheapest ones that together take
BUDGET are fast; where a fixture costs more than the dearest of them, all tests of its file are slow, for the next one would pay.
`make test-times options='-m "not slow"'` measures the fast ones alone: the list grows by those that no longer are.
"""

import os
import sys
from collections import defaultdict
from collections.abc import Collection
from pathlib import Path

import pytest

SLOW = Path(__file__).parents[2] / "slow_tests.txt"
BUDGET = 80.0
"""s of processor time, shared by two processes, each of which finds all tests before its first"""


def name_of(node: str) -> str:
    """A test without its parameters."""
    return node.split("[")[0]


class TestTimes:
    """Notes in a file what the tests of this process took."""

    def __init__(self, path: Path) -> None:
        self._path, self._rows = path, []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item):
        yield from self._timed("setup", item.nodeid)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item):
        yield from self._timed("call", item.nodeid)

    def _timed(self, phase, node):
        start = _processor_time()
        try:
            return (yield)
        finally:
            self._rows.append(f"{_processor_time() - start:.3f} {phase} {name_of(node)}\n")

    def pytest_sessionfinish(self):
        with self._path.open("a") as file:
            file.writelines(self._rows)


def _processor_time() -> float:
    return sum(os.times()[:4])


def slow_tests(rows: list[str], before: Collection[str] = ()) -> list[str]:
    """The tests that are slow, by what was noted; those that were slow `before` and were not run still are."""
    took: dict[str, float] = defaultdict(float)
    setup: dict[str, float] = defaultdict(float)
    for row in rows:
        seconds, phase, name = row.split(maxsplit=2)
        took[name] += float(seconds)
        if phase == "setup":
            file = name.split("::")[0]
            setup[file] = max(setup[file], float(seconds))
    spent, dearest, fast = 0.0, 0.0, set()
    for name in sorted(took, key=took.__getitem__):
        spent += took[name]
        if spent > BUDGET:
            break
        fast.add(name)
        dearest = took[name]
    slow = {name for name in took if name not in fast or setup[name.split("::")[0]] > dearest}
    return sorted(slow | (set(before) - set(took)))


if __name__ == "__main__":
    rows, before = Path(sys.argv[1]).read_text().splitlines(), SLOW.read_text().split() if "some" in sys.argv else ()
    SLOW.write_text("\n".join(slow_tests(rows, before)) + "\n")
    print(f"{SLOW} is written")
