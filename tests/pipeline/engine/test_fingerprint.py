"""What counts as a change of code: every module that a function needs, and no comment."""

import pytest

from orthomill.pipeline.engine import fingerprint


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package `orthomill.tasks.toy` whose module imports another by its name; changing a file is seen at once."""
    (tmp_path / "tasks" / "toy").mkdir(parents=True)
    (tmp_path / "tasks" / "toy" / "__init__.py").write_text("")
    text = "def answer():\n    from orthomill.tasks.toy import numbers\n    return numbers.ONE\n"
    (tmp_path / "tasks" / "toy" / "method.py").write_text(text)
    (tmp_path / "tasks" / "toy" / "numbers.py").write_text("ONE = 1\n")
    monkeypatch.setattr("orthomill.tasks.__path__", [str(tmp_path / "tasks")])
    return tmp_path / "tasks" / "toy"


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
