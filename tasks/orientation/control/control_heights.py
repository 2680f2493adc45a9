"""Heights of control: unknown ones, those in feet, and those that refer to another surface than the positions.

A point without a height holds the block in plan only: its height gets a standard error beside which nothing else counts.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.control_findings import (
    ControlFinding,
    HeightsAllZero,
    HeightsInFeet,
    HeightsOfTwoSystems,
    HeightsUnknown,
)
from orthomill.schemas.observations import NO_HEIGHT, ControlPoint
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ANY_CRS
from orthomill.schemas.survey_files.written_numbers import STAND_INS
from orthomill.tasks.geometry.coordinate_ranges import FOOT
from orthomill.tasks.geometry.survey_system import ellipsoidal, height_unit, survey_crs, transform_surveyed, vertical_name

_ENOUGH_HEIGHTS = 3
"""Points that are all at the height 0 by more than chance"""
_HIGH = 20.0
"""m: where all other points are higher than this (or lower than its negative), one at exactly 0 has no height"""
_ABOVE = 1.5
"""times as high as the highest camera: where control of a flight lies so high, its heights are in feet"""


def without_stand_ins(points: tuple[ControlPoint, ...]) -> tuple[tuple[ControlPoint, ...], dict[str, float]]:
    """The points with NaN as height where a program has written a number for none, and these numbers by name."""
    numbers = {point.name: point.xyz[2] for point in points if point.role != "tie" and point.xyz[2] in STAND_INS}
    bare = (point.model_copy(update={"xyz": (*point.xyz[:2], math.nan)}) if point.name in numbers else point for point in points)
    return tuple(bare), numbers


def with_free_heights(
    points: tuple[ControlPoint, ...],
    photos: Photos,
    crs: str,
    stand_ins: Mapping[str, float] = MappingProxyType({}),
    path: str = "",
) -> tuple[tuple[ControlPoint, ...], tuple[ControlFinding, ...]]:
    """Surveyed points whose heights are unknown, with a standard error that says so, and what was found; `stand_ins` as in
    `without_stand_ins`, `path`: the file of the points."""
    surveyed = [point for point in points if point.role != "tie"]
    missing = {point.name for point in surveyed if math.isnan(point.xyz[2])}
    known = [point for point in surveyed if point.name not in missing]
    zero = {point.name for point in known if point.xyz[2] == 0.0}
    placed = [photo.position[2] for photo in photos.photos if photo.position is not None]
    found: list[ControlFinding] = []
    # A local system may have its origin in the floor on which all targets lie; and two points may well be equally high.
    if crs != ANY_CRS and len(zero) == len(known) >= _ENOUGH_HEIGHTS:
        # Without positions these heights are the only ones that hold the block.
        found.append(HeightsAllZero(points=len(zero), freed=bool(placed)))
        missing |= zero if placed else set()
    elif zero and crs != ANY_CRS and _all_high([point.xyz[2] for point in known if point.name not in zero]):
        found.append(HeightsUnknown(**_named(known, zero, path), zero=True, left_out=_checks(known, zero)))
        missing |= zero
    if nan := {point.name for point in surveyed if math.isnan(point.xyz[2])}:
        numbers = tuple(sorted({value for name, value in stand_ins.items() if name in nan}))
        alone, lost = not known and not placed, _checks(surveyed, nan)
        found.append(HeightsUnknown(**_named(surveyed, nan, path), left_out=lost, numbers=numbers, alone=alone))
    if missing and not known and not placed:
        # Nothing else holds the block in height: the points keep a common one.
        return tuple(_at_zero(point) if point.name in missing else point for point in points), tuple(found)
    if not missing:
        return points, tuple(found)
    heights = [point.xyz[2] for point in known if point.name not in missing] or placed or [0.0]
    stand_in = float(np.median(heights))
    # A check point without a height would be compared with nothing.
    kept = (point for point in points if not (point.name in missing and point.role == "check"))
    return tuple(_free(point, stand_in) if point.name in missing else point for point in kept), tuple(found)


def _all_high(heights: list[float]) -> bool:
    return len(heights) >= 2 and (min(heights) > _HIGH or max(heights) < -_HIGH)


def _named(points: list[ControlPoint], names: set[str], path: str) -> dict[str, Any]:
    """The points of these names for a finding, in their order, with their lines in the file where they have any."""
    told = [point for point in points if point.name in names]
    lines = tuple(point.line for point in told if point.line is not None)
    place = {"lines": lines, "path": path} if path and len(lines) == len(told) else {}
    return {"points": tuple(point.name for point in told), **place}


def _checks(points: list[ControlPoint], names: set[str]) -> tuple[str, ...]:
    return tuple(point.name for point in points if point.name in names and point.role == "check")


def _at_zero(point: ControlPoint) -> ControlPoint:
    return point.model_copy(update={"xyz": (*point.xyz[:2], 0.0)})


def _free(point: ControlPoint, height: float) -> ControlPoint:
    (x, y, _), (sx, sy, _) = point.xyz, point.sigma
    return point.model_copy(update={"xyz": (x, y, height), "sigma": (sx, sy, NO_HEIGHT)})


def about_feet(xyz: np.ndarray, system: str, photos: Photos) -> list[ControlFinding]:
    """Whether heights of points (N, 3) were converted from feet, as the plan of their system is in feet, or look like feet: above
    all cameras, and below them if they were."""
    unit = height_unit(system)
    if abs(unit - 1.0) > 1e-6:
        return [] if survey_crs(system).is_compound else [HeightsInFeet(crs=system, unit_m=unit, converted=True)]
    cameras = [photo.position[2] for photo in photos.photos if photo.position is not None]
    heights = xyz[np.isfinite(xyz[:, 2]), 2]
    if not cameras or not len(heights) or min(cameras) <= 0.0:
        return []
    middle = float(np.median(heights))
    if middle > _ABOVE * max(cameras) and FOOT * middle < min(cameras):
        return [HeightsInFeet(crs=system, unit_m=FOOT, converted=False)]
    return []


class Raised(NamedTuple):
    """Points (N, 3) with heights that refer to the surface of those of the positions, and what was found (None: nothing)."""

    xyz: np.ndarray
    finding: HeightsOfTwoSystems | None


def at_the_heights_of_positions(given: np.ndarray, xyz: np.ndarray, system: str, crs: str, photos: Photos) -> Raised:
    """Points `xyz` in the project's system, from `given` ones in their own, with heights brought to those of the positions where
    the project has no vertical datum but both of them have one."""
    own, kinds = vertical_name(system), {photo.height_kind for photo in photos.photos if photo.position is not None}
    if vertical_name(crs) is not None or own is None or len(kinds) != 1 or crs == ANY_CRS:
        return Raised(xyz, None)
    (kind,) = kinds
    above_ellipsoid = own.startswith("ellipsoid")
    if kind not in ("ellipsoidal", "sea_level") or (kind == "ellipsoidal") == above_ellipsoid:
        return Raised(xyz, None)
    positions = "the ellipsoid" if kind == "ellipsoidal" else "the sea"
    told = HeightsOfTwoSystems(control=own, positions=positions, shift_m=None, crs=_with_vertical(crs, system))
    if above_ellipsoid:
        return Raised(xyz, told)
    try:
        raised, _ = transform_surveyed(given, system, ellipsoidal(crs))
    except WorkflowError:
        return Raised(xyz, told)
    shift = float(np.nanmedian(raised[:, 2] - xyz[:, 2]))
    return Raised(np.column_stack([xyz[:, :2], raised[:, 2]]), told.model_copy(update={"shift_m": round(shift, 3)}))


def _with_vertical(crs: str, system: str) -> str:
    """The project's system with the vertical part of another."""
    known = survey_crs(system)
    code = known.sub_crs_list[1].to_epsg() if known.is_compound else None
    return f"{crs}+{code}" if code else f"{crs}+..."
