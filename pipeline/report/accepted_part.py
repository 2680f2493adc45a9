"""What `orthomill accept` said of a run, as its report shows it."""

from pathlib import Path

from pydantic import ValidationError

from orthomill.schemas.accuracy.acceptance import AcceptanceResult

ACCEPTANCE = "acceptance.json"
"""in the folder of the run"""


def accepted_part(folder: Path) -> AcceptanceResult | None:
    """The last acceptance, if it is of the products that lie in the run's folder now; None without one, where a product is newer,
    and for one that cannot be read."""
    path = folder / ACCEPTANCE
    if not path.is_file():
        return None
    held = path.stat().st_mtime_ns
    products = [file for kind in ("*.tif", "*.vrt", "*.json") for file in (folder / "products").glob(kind)]
    if any(file.stat().st_mtime_ns > held for file in products):
        return None
    return read_acceptance(folder)


def read_acceptance(folder: Path) -> AcceptanceResult | None:
    """The last acceptance of a run; None without one, and for one that cannot be read."""
    try:
        return AcceptanceResult.model_validate_json((folder / ACCEPTANCE).read_text(encoding="utf-8"))
    except (OSError, ValidationError, UnicodeDecodeError):
        return None
