"""Every command line and every block of YAML of the documentation is one that orthomill understands."""

import re
import shlex

import pytest
from documentation import PAGES, ROOT, commands
from typer.main import get_command

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.export.export_formats import BY_NAME, FORMATS, names_in_words, with_table


def mistake(line: str) -> str:
    """What is wrong with a command line; empty where nothing is."""
    words = [word for word in shlex.split(line)[1:] if word != "..."]
    if words and words[0] in ("--version", "--help"):
        return ""
    command = get_command(app)
    while inner := getattr(command, "commands", None):
        if not words:
            return ""
        if (name := words.pop(0)) not in inner:
            return f"no such command: {line}"
        command = inner[name]
    known = {name for parameter in command.params for name in parameter.opts + parameter.secondary_opts} | {"--help"}
    return "".join(f"{word} is no option: {line}" for word in words if word.startswith("--") and word.split("=")[0] not in known)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_of_the_documentation_exist_with_their_options(page):
    assert [found for line in commands(page) if (found := mistake(line))] == []


def test_the_test_itself_finds_a_wrong_option():
    assert mistake("orthomill export site --as cog --cutlines x") and mistake("orthomill exprt site")
    assert len(commands(ROOT / "docs/guide.md")) > 20 and len(commands(ROOT / "docs/exports.md")) > 10


def test_formats_of_the_documentation_are_those_of_the_command():
    text = (ROOT / "docs/exports.md").read_text()
    assert with_table(text) == text, "the table of docs/exports.md is out of date: make docs"
    assert with_table(text.replace("| `cog` |", "| `cig` |")) == text
    named = {word for page in PAGES for word in re.findall(r"--as ([a-z0-9_]+)", page.read_text())}
    assert named <= set(BY_NAME) and len(BY_NAME) == len(FORMATS) and all(one.name in names_in_words() for one in FORMATS)


def test_every_format_is_read_back_by_some_test():
    rooms = (ROOT / "tests/pipeline/export", ROOT / "tests/orientation/interchange")
    texts = "".join(path.read_text() for room in rooms for path in room.glob("*.py"))
    assert [one.name for one in FORMATS if f'"{one.name}"' not in texts and f"write_{one.name}(" not in texts] == []
