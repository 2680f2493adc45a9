"""Surveyed points of a list, of whatever program, in the system of the products that they inspect."""

import csv
import math
from dataclasses import dataclass

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.observations import NO_HEIGHT, ControlPoint
from orthomill.schemas.photo import Photos
from orthomill.tasks.accuracy.acceptance.delivered_points import SurveyedPoint
from orthomill.tasks.orientation.control.control_files import read_points
from orthomill.tasks.orientation.control.control_rows import StatedControl
from orthomill.tasks.orientation.control.control_system import points_from_file

_ASSUMED = StatedControl()
_OTHERS = StatedControl(sigma_plan=2 * _ASSUMED.sigma_plan, sigma_height=2 * _ASSUMED.sigma_height)
_PLACE = ("ortho_x", "ortho_y")


@dataclass(frozen=True)
class ListedPoints:
    """The points, and what was assumed of them."""

    points: tuple[SurveyedPoint, ...]
    remarks: tuple[str, ...]


def listed_points(text: str, own: str | None, crs: str) -> ListedPoints:
    """The points of a text in the plan system `crs`; `own`: their system, None for the one that the text names, or `crs`. Of a list
    with roles, the check points only. Raises WorkflowError that lists every mistake."""
    control = points_from_file(Photos(photos=()), text, own, crs)
    known = [point for point in control.points if point.role != "tie"]
    checks = [point for point in known if point.role == "check"] or known
    places = _places(text)
    read = read_points(Photos(photos=()), text, _ASSUMED).points
    without = {p.name for p in read if math.isnan(p.xyz[2])}
    # Where no point has a height, control keeps one of zero.
    points = tuple(
        SurveyedPoint(p.name, p.xyz, (*p.sigma[:2], NO_HEIGHT) if p.name in without else p.sigma, places.get(p.name))
        for p in checks
    )
    return ListedPoints(points, (*(finding.sentence for finding in control.findings), *_assumed(text, read)))


def _assumed(text: str, read: tuple[ControlPoint, ...]) -> tuple[str, ...]:
    """A sentence where the list states no standard errors: what it states is the same whatever is assumed."""
    others = read_points(Photos(photos=()), text, _OTHERS).points
    count = sum(one.sigma != other.sigma for one, other in zip(read, others, strict=True))
    if not count:
        return ()
    return (
        f"{count} of {len(read)} points lack standard errors, for which {_ASSUMED.sigma_plan:g} m in plan and "
        f"{_ASSUMED.sigma_height:g} m in height are assumed: add columns sigma_x, sigma_y, sigma_z.",
    )


def _places(text: str) -> dict[str, tuple[float, float]]:
    """Where somebody measured the points in the orthoimage, by name. Raises WorkflowError."""
    lines = text.splitlines()
    if not lines or not all(column in lines[0] for column in _PLACE):
        return {}
    separator = ";" if ";" in lines[0] else ","
    try:
        rows = [row for row in csv.DictReader(lines, delimiter=separator) if all(row[column] for column in _PLACE)]
        return {row["name"]: (_number(row["ortho_x"]), _number(row["ortho_y"])) for row in rows}
    except (KeyError, ValueError) as error:
        raise WorkflowError(
            f"The columns ortho_x and ortho_y cannot be read ({error}); they are coordinates, beside a column name."
        ) from error


def _number(text: str) -> float:
    return float(text.replace(",", "."))
