"""What docstrings, comments and pages refer to in docs/sources exists: pages, their anchors, and the codes that stand for them."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "docs" / "sources"
CODE = [
    path
    for folder in ("orthomill", "pipeline", "schemas", "tasks", "tests", "benchmarks")
    for path in (ROOT / folder).rglob("*.py")
]
PAGES = [*(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]

ANCHOR = re.compile(r'<a id="([^"]+)">|\{#([\w-]+)\}')
REFERENCE = re.compile(r"\bsources/(\w+)\.md((?:(?:,| to| and)?\s*#[\w-]+)*)")
RETIRED = re.compile(r"\bmethods/\w+\.md|methods? page")
NUMBERS = r"{0}(?:(?:, | and | to ){0})*"
LISTS = {  # a list of numbers behind a word, and what their anchors begin with
    "check-": re.compile(rf"\b[Cc]hecks? ({NUMBERS.format('[0-9]+')})\b"),
    "table-": re.compile(rf"\b[Tt]ables? ({NUMBERS.format('[0-9]+[.-][0-9]+')})\b"),
    "eq-": re.compile(rf"(?<![0-9]{{4}}, )\b[Ee]quations? ({NUMBERS.format('[0-9]+[.][0-9]+')})\b"),
}
# S3 is the protocol of object stores.
SHORT = re.compile(r"(?<![\w.-])((?!S3\b)[SV][0-9]{1,2}|M[0-9]{1,2}[ab]?|[AB]-[0-9]{2})(?![\w-]|\.[0-9])")
WORTH_PARSING = re.compile(
    rf"{REFERENCE.pattern}|{RETIRED.pattern}|{SHORT.pattern}|[Cc]hecks? [0-9]|[Tt]ables? [0-9]+[.-]|[Ee]quations? [0-9]"
)


def anchors_of(page: Path) -> set[str]:
    """The anchors that a page sets by name."""
    return {first or second for first, second in ANCHOR.findall(page.read_text())}


ANCHORS = {page.stem: anchors_of(page) for page in SOURCES.glob("*.md")}


def prose_of(text: str) -> str:
    """Docstrings and comments of a module."""
    found = [
        node.value.value
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    ]
    comments = [token.string for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type == tokenize.COMMENT]
    return "\n".join([*found, *comments])


def named_anchors(prose: str) -> list[tuple[str, str]]:
    """Page and anchor of every reference; an empty anchor for the page as a whole."""
    found = []
    for page, behind in REFERENCE.findall(prose):
        found += [(page, anchor) for anchor in re.findall(r"#([\w-]+)", behind)] or [(page, "")]
    return found


def codes_of(prose: str) -> set[str]:
    """The anchors that codes stand for: S5, M10, A-18, check 14, tables 4.6 to 4.9."""
    found = {code.lower() for code in SHORT.findall(prose)}
    for prefix, pattern in LISTS.items():
        found |= {
            prefix + number.replace(".", "-")
            for match in pattern.findall(prose)
            for number in re.findall(r"[0-9]+(?:[.-][0-9]+)?", match)
        }
    return found


def dangling(prose: str) -> list[str]:
    """What leads nowhere: pages, anchors, and codes that no page named here explains."""
    named = named_anchors(prose)
    missing = [
        f"sources/{page}.md#{anchor}".rstrip("#")
        for page, anchor in named
        if anchor not in {"", *ANCHORS.get(page, ())} or page not in ANCHORS
    ]
    explained = {anchor for page, _ in named for anchor in ANCHORS.get(page, ())}
    return missing + sorted(codes_of(prose) - explained) + RETIRED.findall(prose)


def test_docstrings_and_comments_refer_to_what_is_there():
    found = {}
    for path in CODE:
        text = path.read_text()
        if path != Path(__file__) and WORTH_PARSING.search(text) and (missing := dangling(prose_of(text))):
            found[str(path.relative_to(ROOT))] = missing
    assert not found


def test_pages_refer_to_what_is_there():
    found = {str(page.relative_to(ROOT)): dangling(page.read_text()) for page in PAGES}
    assert not {page: missing for page, missing in found.items() if missing}


def test_links_among_the_sources_lead_somewhere():
    for page in SOURCES.glob("*.md"):
        links = re.findall(r"\]\((?:(\w+)\.md)?#([\w-]+)\)", page.read_text())
        assert not [link for link in links if link[1] not in ANCHORS[link[0] or page.stem]], page.name


def test_an_anchor_is_set_once():
    for page in SOURCES.glob("*.md"):
        set_here = ANCHOR.findall(page.read_text())
        assert len(set_here) == len(set(set_here)), page.name


@pytest.mark.parametrize(
    ("prose", "missing"),
    [
        ("Source: Kawka 2021, S5 and S6 (sources/calibration.md).", []),
        ("Source: Kawka 2021, S5 and S77 (sources/calibration.md).", ["s77"]),
        ("Source: Karfis 2009 (sources/epipolar.md#spikes, #nothing).", ["sources/epipolar.md#nothing"]),
        ("Source: sources/nowhere.md.", ["sources/nowhere.md"]),
        ("Source: (sources/epipolar.md#return), checks 8, 9 and 99.", ["check-99"]),
        ("A code without a page: M10.", ["m10"]),
        ("Tables 4.6 to 4.99 of sources/matching.md", ["table-4-99"]),
        ("Source: methods/calibration.md.", ["methods/calibration.md"]),
        ("Snyder 1987, equation 8.9.", []),
    ],
)
def test_a_reference_that_leads_nowhere_is_found(prose, missing):
    assert dangling(prose) == missing
