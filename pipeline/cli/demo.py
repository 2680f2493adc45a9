"""The embedded project: the workflow that comes with the package, written where the user stands."""

from pathlib import Path

WORKFLOW = "volos_small.yaml"


def write_demo(root: Path) -> Path:
    """Write the workflow to `workflows/` below `root`, unless it is there, and return its path."""
    path = root / "workflows" / WORKFLOW
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text((Path(__file__).parent / WORKFLOW).read_text(encoding="utf-8"), encoding="utf-8")
    return path
