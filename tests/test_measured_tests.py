"""The list of slow tests follows from what was measured, and names tests that there are."""

import ast
from pathlib import Path

from measured_tests import BUDGET, SLOW, slow_tests

ROOT = Path(__file__).parents[1]


def test_the_cheapest_tests_within_the_budget_are_fast():
    rows = [f"{BUDGET / 4} call a.py::one", f"{BUDGET / 2} call a.py::two", "1 setup b.py::three", f"{BUDGET} call b.py::three"]
    assert slow_tests(rows) == ["b.py::three"]


def test_a_dear_fixture_makes_its_file_slow():
    rows = [f"{BUDGET} setup a.py::one", "1 call a.py::one", "1 call a.py::two", "0.5 call b.py::three"]
    assert slow_tests(rows) == ["a.py::one", "a.py::two"]


def test_what_was_not_run_stays_slow():
    rows = [f"{BUDGET / 4} call a.py::one", f"{BUDGET} call a.py::two"]
    assert slow_tests(rows, ("a.py::one", "c.py::three")) == ["a.py::two", "c.py::three"]


def test_all_tests_of_the_list_exist():
    listed = SLOW.read_text().split()
    assert listed == sorted(set(listed))
    for file in {name.split("::")[0] for name in listed}:
        defined = {node.name for node in ast.walk(ast.parse((ROOT / file).read_text())) if isinstance(node, ast.FunctionDef)}
        missing = [name for name in listed if name.split("::")[0] == file and name.rsplit("::", 1)[1] not in defined]
        assert not missing, f"make test-times; {missing}"
