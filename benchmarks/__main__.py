"""The one command: `python -m benchmarks` lists what can be measured, `python -m benchmarks NAME... [WORDS]` measures it.

    python -m benchmarks                            what can be measured, what that needs, how long it takes
    python -m benchmarks volos matching             these two, with their defaults
    python -m benchmarks volos runs/volos           one, with words of its own; `--` stands before words that are names of studies
    python -m benchmarks all                        all that need nothing but this repository, the quickest first
    python -m benchmarks stale                      pages that are older than the code that they measure

`make bench`, `make bench only=volos,matching`, `make bench only=volos options="runs/volos"` and `make bench-stale` are the same.
"""

import difflib
import sys

from benchmarks.instrument.stale_pages import stale_lines
from benchmarks.instrument.studies import STUDIES
from benchmarks.instrument.study import COSTS, Study


def main(words: list[str]) -> None:
    """Lists, measures, or tells which pages are old."""
    if not words:
        print("\n".join(listed()))
    elif words == ["stale"]:
        print("\n".join(stale_lines(STUDIES.values())) or "No page is older than the code that it measures.")
    else:
        names, own = asked(words)
        for name in names:
            STUDIES[name].main(own)


def asked(words: list[str]) -> tuple[list[str], list[str]]:
    """Names of studies, and words for them. Raises SystemExit with a sentence for a name that there is not."""
    names: list[str] = []
    while words and words[0] != "--" and all(name in STUDIES or name == "all" for name in words[0].split(",")):
        names += words.pop(0).split(",")
    if not names:
        near = difflib.get_close_matches(words[0], STUDIES, 1)
        raise SystemExit(f"There is no study {words[0]!r}{f'; {near[0]}?' if near else ''}: `python -m benchmarks` lists them.")
    if "all" in names:
        names = [study.name for study in by_cost() if not study.needs]
    own = words[1:] if words[:1] == ["--"] else words
    if own and len(names) > 1:
        raise SystemExit(f"{' '.join(own)!r}: words can be given to one study at a time, and these are {len(names)}.")
    return names, own


def by_cost() -> list[Study]:
    """All studies, the quickest first."""
    return sorted(STUDIES.values(), key=lambda study: COSTS.index(study.cost))


def listed() -> list[str]:
    """What can be measured."""
    width = max(map(len, STUDIES))
    lines = [
        "python -m benchmarks NAME... [WORDS]",
        "all: those that need nothing but this repository; stale: pages older than the code that they measure",
        "",
    ]
    for study in by_cost():
        lines.append(f"{study.name:{width}}  {study.cost:8}  {study.measures}")
        for what, text in (("needs", study.needs), ("words", study.words)):
            lines += [f"{'':{width + 12}}{what}: {text}"] if text else []
    return lines


if __name__ == "__main__":
    main(sys.argv[1:])
