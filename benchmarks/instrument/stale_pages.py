"""Pages that are older than the code they measure: how many commits have changed that code since."""

import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.instrument.result_page import ROOT, head_of
from benchmarks.instrument.study import Study


@dataclass(frozen=True)
class PageAge:
    """A page, the commit that it was measured at, its date, and the commits that have changed the code that it measures."""

    page: str
    study: str
    commit: str
    date: str
    changes: int


def ages(studies: Iterable[Study], root: Path = ROOT) -> Iterator[PageAge]:
    """Every page of the studies, with what has changed since."""
    for study in studies:
        for path in sorted({path for pattern in study.written for path in root.glob(pattern)}):
            head = head_of(path)
            page = path.relative_to(root).as_posix()
            came, date = _git(root, "log", "-1", "--format=%h %cs", "--", page).split()
            # Of a commit that was rewritten before it came here, nothing is known: then that counts which brought the page.
            known = head is not None and _is_commit(root, head.commit)
            since = head.commit if head and known else came
            changes = len(_git(root, "log", "--format=%h", f"{since}..HEAD", "--", *study.code).split())
            yield PageAge(page, study.name, since, head.date if head else date, changes)


def stale_lines(studies: Iterable[Study], root: Path = ROOT) -> list[str]:
    """The pages that are older than their code, those of most changes first, as lines of a table."""
    found = sorted((age for age in ages(studies, root) if age.changes), key=lambda age: (-age.changes, age.page))
    width = max((len(age.page) for age in found), default=0)
    return [f"{age.page:{width}}  {age.date}  {age.commit}  {age.changes:4} commits since  {age.study}" for age in found]


def _is_commit(root: Path, name: str) -> bool:
    words = ["git", "-C", str(root), "merge-base", "--is-ancestor", name, "HEAD"]
    return subprocess.run(words, capture_output=True).returncode == 0


def _git(root: Path, *words: str) -> str:
    return subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=True).stdout
