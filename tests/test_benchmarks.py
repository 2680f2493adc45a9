"""Every benchmark can be started: what it takes from the stages is still there; every study and every page is in the register."""

import ast
import importlib
import json
import subprocess
from inspect import signature
from pathlib import Path

import pytest

from benchmarks.__main__ import asked, listed
from benchmarks.instrument import result_page
from benchmarks.instrument.result_page import PageHead, head_of, new_head, write_page
from benchmarks.instrument.stale_pages import ages, stale_lines
from benchmarks.instrument.studies import STUDIES
from benchmarks.instrument.study import Study

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "benchmarks").rglob("*.py")
    # It runs in the environment of the peer.
    if path.name not in ("orthority_worker.py", "qgis_reader.py", "xml_validator.py", "__init__.py")
)
ALONE = {"benchmarks.orthority_worker", "benchmarks.orientation.colmap_block"}
"""programs that run in the environment of a peer"""


@pytest.mark.parametrize("module", MODULES)
def test_its_imports_exist(module):
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name and error.name.split(".")[0] in ("benchmarks", "orthomill"):
            raise
        pytest.skip(f"needs {error.name}, a program to compare with")


@pytest.mark.parametrize("study", STUDIES.values(), ids=lambda study: study.name)
def test_a_study_runs_from_words_and_measures_code_that_exists(study):
    assert list(signature(study.main).parameters) == ["words"]
    assert not [folder for folder in study.code if not (ROOT / folder).is_dir()]


def test_every_page_belongs_to_one_study_and_begins_with_command_commit_machine_and_date():
    owners = {page: study for study in STUDIES.values() for pattern in study.written for page in ROOT.glob(pattern)}
    pages = [*(ROOT / "benchmarks" / "results").glob("*.md"), ROOT / "docs" / "compare.md", ROOT / "docs" / "mission.md"]
    assert set(pages) == set(owners)
    heads = {page.name: (head_of(page), owners[page].name) for page in pages}
    assert not [name for name, (head, study) in heads.items() if head is None or head.command.split()[3] != study]


def test_the_gallery_shows_the_figures_that_its_command_found():
    from benchmarks.checking.wrong_surfaces import FAULTS, PAGE, TARGET, with_figures

    page, found = PAGE.read_text(), json.loads((TARGET / "found.json").read_text())
    assert with_figures(page, found) == page and set(found) == set(FAULTS)
    assert all(f"pictures/wrong/{name}.jpg" in page and (TARGET / f"{name}.jpg").is_file() for name in FAULTS)


def imported(path: Path) -> set[str]:
    """Modules of the benchmarks that a file imports, names of packages with every name that is taken from them."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("benchmarks"):
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def test_no_module_is_forgotten():
    files = {module: ROOT / f"{module.replace('.', '/')}.py" for module in MODULES}
    waiting = {"benchmarks.__main__", *(f"benchmarks.{study.module}" for study in STUDIES.values())}
    waiting |= {name for path in (ROOT / "tests").rglob("*.py") if path != Path(__file__) for name in imported(path)}
    reached: set[str] = set()
    while waiting:
        module = waiting.pop()
        if module in files and module not in reached:
            reached.add(module)
            waiting |= imported(files[module])
    assert set(files) - reached - ALONE == set()


def test_names_come_first_and_words_go_to_one_study():
    assert asked(["volos"]) == (["volos"], [])
    assert asked(["volos,matching", "chaos"]) == (["volos", "matching", "chaos"], [])
    assert asked(["volos", "runs/volos", "runs/other"]) == (["volos"], ["runs/volos", "runs/other"])
    assert asked(["cost_of_trust", "--", "volos"]) == (["cost_of_trust"], ["volos"])
    with pytest.raises(SystemExit, match=r"no study 'volo'; volos\?"):
        asked(["volo"])
    with pytest.raises(SystemExit, match="one study at a time, and these are 2"):
        asked(["volos,matching", "runs/volos"])


def test_all_are_those_that_need_nothing_the_quickest_first():
    names, _ = asked(["all"])
    assert set(names) == {study.name for study in STUDIES.values() if not study.needs}
    assert STUDIES[names[0]].cost == "seconds" and STUDIES[names[-1]].cost == "hours"
    assert all(any(line.startswith(name) for line in listed()) for name in STUDIES)


def test_what_a_head_says_can_be_read_again(tmp_path, monkeypatch):
    monkeypatch.setattr(result_page, "RESULTS", tmp_path)
    write_page("volos", ["runs/volos"], "# A title\n\nWords.\n\n| a | b |\n")
    text = (tmp_path / "volos.md").read_text()
    assert text.startswith("# A title\n\n`python -m benchmarks volos runs/volos`; commit ") and text.endswith(
        ".\n\nWords.\n\n| a | b |\n"
    )
    found = head_of(tmp_path / "volos.md")
    assert found and found.recorded and found.command == "python -m benchmarks volos runs/volos"
    (tmp_path / "old.md").write_text(f"# Old\n\n{found._replace(recorded=False)}\n")
    assert head_of(tmp_path / "old.md") == found._replace(recorded=False)
    (tmp_path / "none.md").write_text("# None\n\nWords.\n")
    assert head_of(tmp_path / "none.md") is None


@pytest.fixture
def repository(tmp_path, monkeypatch) -> Path:
    """A repository with code, a page that was measured there, and an own author."""
    for role in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{role}_NAME", "nobody")
        monkeypatch.setenv(f"GIT_{role}_EMAIL", "nobody@example.org")
    (tmp_path / "code").mkdir()
    subprocess.run(["git", "-C", str(tmp_path), "init", "--quiet"], check=True)
    committed(tmp_path, "code/one.py", "first")
    return tmp_path


def committed(root: Path, name: str, text: str) -> str:
    """The commit of a file."""
    (root / name).write_text(text)
    for words in (("add", name), ("commit", "--quiet", "-m", name)):
        subprocess.run(["git", "-C", str(root), *words], check=True)
    return subprocess.run(
        ["git", "-C", str(root), "log", "-1", "--format=%h"], check=True, capture_output=True, text=True
    ).stdout.strip()


def page_at(commit: str) -> str:
    return f"# Page\n\n{PageHead('python -m benchmarks study', commit, True, 'a machine', '2026-01-02')}\n"


STUDY = Study("study", "study", "nothing", "seconds", ("code",), pages=("*.md",))


def test_a_page_is_old_once_the_code_that_it_measures_has_changed(repository):
    commit = committed(repository, "code/one.py", "measured")
    committed(repository, "page.md", page_at(commit))
    committed(repository, "other.py", "not measured")
    assert [age.changes for age in ages([STUDY], repository)] == [0] and not stale_lines([STUDY], repository)
    committed(repository, "code/two.py", "changed")
    (line,) = stale_lines([STUDY], repository)
    assert line.split() == ["page.md", "2026-01-02", commit, "1", "commits", "since", "study"]


def test_a_page_of_a_commit_that_is_not_here_counts_from_the_commit_that_brought_it(repository):
    brought = committed(repository, "page.md", page_at("0123456"))
    committed(repository, "code/one.py", "changed")
    (age,) = ages([STUDY], repository)
    assert (age.commit, age.changes) == (brought, 1)


def test_a_head_says_whether_the_code_was_changed_since_its_commit(repository, monkeypatch):
    monkeypatch.setattr(result_page, "ROOT", repository)
    monkeypatch.setattr(result_page, "CODE", ("code",))
    assert "with changes" not in new_head("volos", []).commit
    (repository / "code" / "one.py").write_text("changed")
    assert new_head("volos", []).commit.endswith(" with changes")


def test_every_published_check_of_textures_is_made_where_the_page_says():
    checks = importlib.import_module("benchmarks.texture.published_checks_of_textures").CHECKS
    assert list(checks) == [f"A-{number:02d}" for number in range(1, 29)]
    for _, where in checks.values():
        path, _, name = where.partition("::")
        assert (ROOT / path).is_file() and f"def {name}" in (ROOT / path).read_text() if name else (ROOT / path).is_file(), where
