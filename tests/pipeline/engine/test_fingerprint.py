"""What counts as a change: of values, of files, and of code, which is every module that a function needs and no comment."""

import os
import sys
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from orthomill.pipeline.engine import fingerprint
from orthomill.pipeline.engine.module_syntax import SyntaxFile
from orthomill.schemas.raster import MapGrid, Window


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package `orthomill.tasks.toy` whose module imports another by its name; changing a file is seen at once."""
    (tmp_path / "tasks" / "toy").mkdir(parents=True)
    (tmp_path / "tasks" / "toy" / "__init__.py").write_text("")
    text = "def answer():\n    from orthomill.tasks.toy import numbers\n    return numbers.ONE\n"
    (tmp_path / "tasks" / "toy" / "method.py").write_text(text)
    (tmp_path / "tasks" / "toy" / "numbers.py").write_text("ONE = 1\n")
    monkeypatch.setattr("orthomill.tasks.__path__", [str(tmp_path / "tasks")])
    monkeypatch.setattr(fingerprint, "_kept", lambda: SyntaxFile(tmp_path / "syntax.json"))
    yield tmp_path / "tasks" / "toy"
    sys.modules.pop("orthomill.tasks.toy", None)  # looking for a module imports its package, which would stay for the next test


def digest() -> str:
    fingerprint._syntax.cache_clear()
    fingerprint.of_modules.cache_clear()
    return fingerprint.of_modules("orthomill.tasks.toy.method")


def test_a_module_imported_by_name_from_its_package_counts(package):
    before = digest()
    (package / "numbers.py").write_text("ONE = 1.0\n")
    assert digest() != before


def test_comments_and_docstrings_do_not_count(package):
    before = digest()
    (package / "numbers.py").write_text('"""The numbers."""\n\nONE = 1  # one\n')
    assert digest() == before


def test_a_changed_statement_counts(package):
    before = digest()
    (package / "method.py").write_text((package / "method.py").read_text().replace("numbers.ONE", "numbers.ONE + 0"))
    assert digest() != before


def test_a_module_that_is_not_imported_does_not_count(package):
    before = digest()
    (package / "stranger.py").write_text("TWO = 2\n")
    assert digest() == before


class Colour(StrEnum):
    """A word."""

    RED = "red"


class Code(IntEnum):
    """A number."""

    RED = 1


@dataclass(frozen=True)
class Point:
    """A value type."""

    x: float
    y: float


class Model(BaseModel):
    """Settings with the fields of a point."""

    x: float
    y: float


DISTINCT = (
    None,
    True,
    1.5,
    "1",
    (1, 2),
    (2, 1),
    ((1,), 2),
    {"a": 1},
    {"b": 1},
    Point(1, 2),
    Point(2, 1),
    Model(x=1, y=2),
    Model(x=2, y=1),
    Colour.RED,
    Code.RED,
    np.array([1, 2]),
    np.array([1.0, 2.0]),
    np.array([[1, 2]]),
    np.array([2, 1]),
    Window(0, 0, 1, 2),
    MapGrid(west=0, north=0, cell=1, rows=1, cols=1),
    Point,
    Model,
)


def test_different_values_have_different_fingerprints():
    """Also where they would print alike: a point and a model with its fields, a word and the code of the same name."""
    assert len({fingerprint.of_value(value) for value in DISTINCT}) == len(DISTINCT)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4).map(tuple) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=10,
)


@settings(max_examples=100, deadline=None)
@given(value=PLAIN)
def test_equal_values_have_equal_fingerprints_whatever_the_order_of_their_keys(value):
    turned = dict(reversed(value.items())) if isinstance(value, dict) else value
    assert fingerprint.of_value(value) == fingerprint.of_value(turned)
    assert fingerprint.of_value({"value": value}) != fingerprint.of_value({"other": value})


def test_lists_and_tuples_are_alike_and_numpy_scalars_are_numbers():
    assert fingerprint.of_value([1, 2]) == fingerprint.of_value((1, 2))
    assert fingerprint.of_value(np.float64(0.1)) == fingerprint.of_value(0.1)
    assert fingerprint.of_value(np.arange(4)[::2]) == fingerprint.of_value(np.array([0, 2]))


@pytest.mark.parametrize("value", [{1, 2}, object(), iter(()), b"bytes", {"deep": [open]}])
def test_what_has_no_stable_text_is_refused(value):
    with pytest.raises(TypeError, match="has no fingerprint; pass numbers, text, tuples"):
        fingerprint.of_value(value)


@given(parts=st.lists(st.text(st.characters(exclude_characters="\0"), max_size=5), min_size=2, max_size=4, unique=True))
@settings(max_examples=50, deadline=None)
def test_parts_of_a_digest_do_not_run_together(parts):
    assert fingerprint.digest(*parts) != fingerprint.digest("".join(parts))
    assert fingerprint.digest(*parts) != fingerprint.digest(*reversed(parts))


def test_a_file_counts_with_its_content_and_not_with_its_name_or_time(tmp_path):
    one, other = tmp_path / "a.jpg", tmp_path / "b.jpg"
    one.write_bytes(b"pixels")
    other.write_bytes(b"pixels")
    os.utime(other, (1, 1))
    assert fingerprint.of_file(one) == fingerprint.of_file(other)
    one.write_bytes(b"other pixels")
    assert fingerprint.of_file(one) != fingerprint.of_file(other)
    with pytest.raises(FileNotFoundError):
        fingerprint.of_file(tmp_path / "c.jpg")


def test_functions_of_one_module_differ():
    """Two jobs of one stage must not take each other's results for their own."""
    assert fingerprint.of_code(fingerprint.digest) != fingerprint.of_code(fingerprint.of_value)
    assert fingerprint.of_code(fingerprint.digest) == fingerprint.of_code(fingerprint.digest)


def test_another_version_of_a_library_counts(monkeypatch):
    before = fingerprint.of_code(fingerprint.digest)
    monkeypatch.setattr(fingerprint, "_libraries", lambda: ("numpy 99",))
    fingerprint.of_code.cache_clear()
    try:
        assert fingerprint.of_code(fingerprint.digest) != before
    finally:
        fingerprint.of_code.cache_clear()
