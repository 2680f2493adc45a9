"""What `orthomill accept` said of a run, as its report shows it."""

from pathlib import Path

from pydantic import ValidationError

from orthomill.schemas.accuracy.acceptance import AcceptanceResult

ACCEPTANCE = "acceptance.json"
"""in the folder of the run"""


def accepted_part(folder: Path) -> AcceptanceResult | None:
    """The clauses of the last acceptance of the products that lie in the run's folder now; None without one, where a product is
    newer, and for one that cannot be read."""
    path = folder / ACCEPTANCE
    if not path.is_file():
        return None
    held = path.stat().st_mtime_ns
    products = [file for kind in ("*.tif", "*.json") for file in (folder / "products").glob(kind)]
    if any(file.stat().st_mtime_ns > held for file in products):
        return None
    try:
        return AcceptanceResult.model_validate_json(path.read_text(encoding="utf-8"))
    except (ValidationError, UnicodeDecodeError):
        return None
