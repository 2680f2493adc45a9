"""Lists of surveyed points that a command is given: a GeoPackage, a CSV, or what a surveyor's program wrote."""

from pathlib import Path

from orthomill.pipeline.storage.geopackage_points import SUFFIX, points_csv
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.survey_files.text_encoding import decoded


def point_list(path: Path, crs: str | None) -> tuple[str, str | None]:
    """The text of a list of points, and its reference system: `crs`, or the one of a GeoPackage. Raises WorkflowError, StoreError
    for what is no text."""
    if not path.is_file():
        raise WorkflowError(f"There is no file {path}; give a CSV, a GeoPackage, or what a surveyor's program wrote.")
    if path.suffix.lower() == SUFFIX:
        text, own = points_csv(path)
        return text, crs or own
    return decoded(path.read_bytes(), str(path)), crs
