"""Which columns of a table of points belong together, which system they are in, and which of the points are check points."""

import re

from orthomill.schemas.maps.system_names import known_crs
from orthomill.schemas.survey_files.table_heads import TableHead
from orthomill.tasks.orientation.control.control_rows import StatedControl


def named_system(head: TableHead, stated: StatedControl) -> str | None:
    """The one system that a column names in all lines, if PROJ knows it; the workflow says more."""
    at = next((i for i, column in enumerate(head.columns) if column.meaning == "system"), None)
    if at is None or stated.crs:
        return None
    found = {cells[at] for _, line in head.data if len(cells := head.separation.cells(line)) > at and cells[at]}
    return next(iter(found)) if len(found) == 1 and known_crs(next(iter(found))) is not None else None


def place_columns(meanings: frozenset[str], system: str | None) -> tuple[str, str, str]:
    """The columns of plan and height that belong together. A receiver's table has longitude, latitude and height above the
    ellipsoid beside easting, northing and height of a system that may have feet: the one that is known."""
    both = {"x", "y", "lon", "lat"} <= meanings
    known = known_crs(system) if system else None
    plane = known.sub_crs_list[0] if known is not None and known.is_compound else known
    degrees = "lon" in meanings and not (both and plane is not None and not plane.is_geographic)
    heights = ("z_ellipsoidal", "z", "z_sea") if degrees and both else ("z", "z_sea", "z_ellipsoidal")
    x, y = ("lon", "lat") if degrees else ("x", "y")
    return x, y, next((word for word in heights if word in meanings), "")


_ROLES = {
    "control": "control gcp ground_control ground_control_point control_point 3d_gcp full",
    "check": "check checkpoint check_point chk ckp icp 3d_check validation check_points",
    "tie": "tie mtp manual_tie_point tie_point",
}
_ROLE_OF_WORD = {word: role for role, words in _ROLES.items() for word in words.split()}


def roles_in(head: TableHead, checks: tuple[str, ...]) -> dict[int, str]:
    """The roles of points by line, where the file tells control from check points in words of its own: Metashape's checks are not
    enabled, others write "GCP" and "Check point". Columns with other words ("concrete") tell nothing; `checks`: what the workflow
    says."""
    at = {column.meaning: i for i, column in enumerate(head.columns)}
    cells = {number: row for number, line in head.data if (row := head.separation.cells(line))}
    named = {n for n, row in cells.items() if len(row) > at["name"] and row[at["name"]] in checks}
    if "enabled" in at:
        own = {n: row[at["enabled"]].lower() for n, row in cells.items() if len(row) > at["enabled"]}
        return {n: "check" for n, word in own.items() if word in ("0", "false", "no")}
    column = at.get("role", at.get("kind"))
    if column is None:
        return {}
    words = {n: re.sub(r"[\s_-]+", "_", row[column].strip().lower()) for n, row in cells.items() if len(row) > column}
    # "CP" is a control point of one school and a check point of another; beside "GCP" it is the latter.
    known = _ROLE_OF_WORD | ({"cp": "check"} if "gcp" in words.values() else {})
    return {n: known[word] for n, word in words.items() if word in known and n not in named}
