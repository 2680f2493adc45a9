"""The pages of the documentation and the command lines on them."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
PAGES = sorted(
    [ROOT / "README.md", *(p for p in (ROOT / "docs").rglob("*.md") if "api" not in p.parts and "sources" not in p.parts)]
)
_LINE = re.compile(r"^ {4,}(?:\$ )?((?:\.venv/bin/)?orthomill .*)$|`(orthomill [^`\n]*)`", re.MULTILINE)


def commands(page: Path) -> list[str]:
    """Command lines of a page, without what a comment says."""
    found = [a or b for a, b in _LINE.findall(re.sub(r"\\\n\s*", "", page.read_text()))]
    return [re.sub(r"\s+#.*$", "", line).removeprefix(".venv/bin/") for line in found]
