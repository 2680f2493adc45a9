"""YAML with line numbers: what is read, and what is refused before it can do harm."""

import pytest

from orthomill.pipeline.workflow.yaml_lines import SIZE_LIMIT, YamlError, read_yaml


def test_values_follow_yaml_1_2():
    document = read_yaml("a: no\nb: 1e-3\nc: '7'\nd: 12:30\ne: ~\nf: [1, 2.5, EPSG:2100]\ng: 0o17\n")
    assert document.value == {"a": "no", "b": 1e-3, "c": "7", "d": "12:30", "e": None, "f": [1, 2.5, "EPSG:2100"], "g": "0o17"}


def test_every_place_knows_its_line():
    document = read_yaml("a: 1\n# remark\nstages:\n  - x\n  - kind: y\n\n    size: 3\n")
    assert document.line(("a",)) == 1
    assert document.line(("stages", 0)) == 4
    assert document.line(("stages", 1, "size")) == 7
    assert document.line(("stages", 1, "absent", "deeper")) == 5


def test_a_repeated_key_is_reported_with_both_lines_and_the_first_counts():
    document = read_yaml("a: {b: 1}\nc: 2\na: {d: 1}\n")
    assert document.value == {"a": {"b": 1}, "c": 2}
    assert document.repeated == ((("a",), 3, 1),)
    assert ("a", "d") not in document.lines


BOMB = "a: &a [x]\n" + "".join(f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join([f'*{chr(97 + i)}'] * 9)}]\n" for i in range(9))


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("a: 1\nb: *x", 2, "aliases are not used"),
        (BOMB, 1, "anchors are not used"),
        ("a: !!python/object/apply:os.system ['true']", 1, "tags are not used"),
        ("[" * 1000, 1, "nested more than"),
        ("a: 1\n\tb: 2", 2, "spaces, not tabs"),
        ("a: 1\nb: c: d", 2, "not valid YAML"),
        ("a: 'x\n", 2, "not valid YAML"),
        ("a: 1\n---\nb: 2", 2, "second document"),
        ("[1]: 2", 1, "a name is needed"),
        ("a: \x07", 1, "not valid YAML"),
        ("#" * (SIZE_LIMIT + 1), 1, "at most"),
    ],
)
def test_what_a_workflow_never_needs_is_refused_with_its_line(text, line, words):
    with pytest.raises(YamlError) as caught:
        read_yaml(text)
    assert caught.value.line == line
    assert words in caught.value.sentence


@pytest.mark.parametrize("text", ["", "# nothing\n", "---\n"])
def test_nothing_is_nothing(text):
    assert read_yaml(text).value is None
