"""The syntax of modules is parsed once for each state of a file, and what is kept of it can be lost or damaged."""

import pytest

from orthomill.pipeline.engine import module_syntax
from orthomill.pipeline.engine.module_syntax import SyntaxFile

SOURCE = '"""Words."""\nimport math\n\ndef f():\n    from a.b import c, d\n    return c\n'


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """The syntax of a module by a fresh process, and how many files it parsed."""
    (tmp_path / "m.py").write_text(SOURCE)
    counted, parsed = [], module_syntax.parsed
    monkeypatch.setattr(module_syntax, "parsed", lambda text: counted.append(text) or parsed(text))

    def ask():
        counted.clear()
        kept = SyntaxFile(tmp_path / "cache" / "syntax.json")
        found = kept.of("m", tmp_path / "m.py")
        kept.save()
        return found, len(counted)

    return ask


def test_a_module_is_parsed_once(asked):
    first, parsed = asked()
    again, more = asked()
    assert (parsed, more) == (1, 0) and again == first
    assert set(first.imports) == {("math", ()), ("a.b", ("c", "d"))}


def test_a_changed_file_is_parsed_again_and_prose_does_not_count(asked, tmp_path):
    before, _ = asked()
    (tmp_path / "m.py").write_text(SOURCE.replace("Words.", "Other words."))
    prose, parsed = asked()
    assert parsed == 1 and prose.source != before.source and prose.tree == before.tree
    (tmp_path / "m.py").write_text(SOURCE.replace("return c", "return d"))
    assert asked()[0].tree != before.tree


@pytest.mark.parametrize("damage", [b"", b"{", b'{"m": ["x", 1, []]}', b"[]", b"\xff\xfe"])
def test_a_damaged_file_is_made_again(asked, tmp_path, damage):
    before, _ = asked()
    (tmp_path / "cache" / "syntax.json").write_bytes(damage)
    assert asked() == (before, 1) and asked() == (before, 0)


def test_what_another_python_parsed_is_not_taken(asked, monkeypatch):
    asked()
    monkeypatch.setattr(module_syntax, "_PYTHON", "2.7")
    assert asked()[1] == 1


def test_a_folder_that_cannot_be_written_costs_time_only(asked, tmp_path):
    (tmp_path / "cache").write_text("a file where the folder should be")
    assert asked()[1] == 1 and asked()[1] == 1
