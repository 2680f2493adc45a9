"""Control whose coordinates are rounded: a list of whole metres, from a web map or a spreadsheet, is no better than 0.3 m."""

import numpy as np

from orthomill.schemas.findings.control_findings import CoordinatesRounded
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.project import ANY_CRS
from orthomill.schemas.survey_files.written_steps import METRES_OF_A_DEGREE, rounding_error, with_rounding
from orthomill.tasks.geometry.survey_system import height_unit, survey_crs

_ENOUGH = 3
"""points, below which round numbers are chance"""


def with_rounded_errors(control: Control, system: str, crs: str) -> tuple[Control, tuple[CoordinatesRounded, ...]]:
    """Control with the standard errors (m) that its coordinates, written in a `system`, can have at best, and what was enlarged;
    those of a local project `crs` may be round by design."""
    surveyed = [point for point in control.points if point.role != "tie"]
    if control.read is None or crs == ANY_CRS or len(surveyed) < _ENOUGH or not any(control.read.steps):
        return control, ()
    plan, height = _metres(control.read.steps, surveyed, system)
    least = np.median([point.sigma for point in surveyed], axis=0)
    if not (rounding_error(plan) > least[:2].min() or rounding_error(height) > least[2]):
        return control, ()
    points = tuple(point if point.role == "tie" else _rounded(point, plan, height) for point in control.points)
    told = CoordinatesRounded(
        points=len(surveyed),
        plan_m=plan if rounding_error(plan) > least[:2].min() else None,
        height_m=height if rounding_error(height) > least[2] else None,
    )
    return control.model_copy(update={"points": points}), (told,)


def _metres(steps: tuple[float, float], surveyed: list[ControlPoint], system: str) -> tuple[float, float]:
    """Steps in plan and height, m."""
    known = survey_crs(system)
    plane = known.sub_crs_list[0] if known.is_compound else known
    degrees = plane.is_geographic or all(abs(point.xyz[0]) <= 180.0 and abs(point.xyz[1]) <= 180.0 for point in surveyed)
    unit = METRES_OF_A_DEGREE if degrees else plane.axis_info[0].unit_conversion_factor
    # Heights that are all 0 were not rounded, but are not there.
    height = steps[1] * height_unit(system) if any(point.xyz[2] for point in surveyed) else 0.0
    return steps[0] * unit, height


def _rounded(point: ControlPoint, plan: float, height: float) -> ControlPoint:
    x, y, z = point.sigma
    return point.model_copy(update={"sigma": (with_rounding(x, plan), with_rounding(y, plan), with_rounding(z, height))})
