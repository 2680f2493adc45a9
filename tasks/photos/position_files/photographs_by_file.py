"""Photographs with the positions of a file: read, matched, placed, with the standard errors and attitudes that they deserve."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pyproj import CRS, Transformer

from orthomill.schemas.errors import WorkflowError, some_of
from orthomill.schemas.findings.position_findings import HeightsOfPositions, PositionsRead
from orthomill.schemas.photo import HeightKind, Photo, PhotoRemark, PhotoRemarkCode
from orthomill.schemas.project import ANY_CRS, PositionsFromFile
from orthomill.schemas.survey_files.photograph_names import PhotographNames, photo_stem
from orthomill.schemas.survey_files.text_encoding import encoding_of
from orthomill.schemas.survey_files.written_steps import METRES_OF_A_DEGREE
from orthomill.tasks.photos.position_files.event_matching import Matched, match_events
from orthomill.tasks.photos.position_files.listed_positions import ListedPosition, PositionList, Triple
from orthomill.tasks.photos.position_files.position_placing import PlacedPositions, attitudes, place
from orthomill.tasks.photos.position_files.position_reading import Deserved, read_positions, standard_errors

LONGEST = 60
"""letters of the name of a system; longer ones are whole definitions"""


class FromFile(NamedTuple):
    """Photographs with positions, remarks about lines and photographs without a partner, what was read, and its heights."""

    photos: list[Photo]
    remarks: list[PhotoRemark]
    read: PositionsRead
    heights: HeightsOfPositions


def placed_by_file(photos: list[Photo], text: str, source: PositionsFromFile | None, crs: str) -> FromFile:
    """The photographs with the positions of a file in the project's system `crs`; `source`: what the workflow states of the file
    (None: nothing, as of a simulated one). Raises WorkflowError."""
    source = source or PositionsFromFile(kind="file", path="")
    listed = read_positions(text, source.errors_in)
    matched, absent = _by_name(listed, photos) if listed.named else (_by_event(listed, photos), ())
    chosen = {name: one for name, one in matched.of_photo.items() if _has_place(one, crs)}
    if not chosen:
        raise WorkflowError("The positions file holds no solution: all of its lines say that the receiver had no position (0).")
    own = replace(listed, positions=tuple(replace(one, name=name) for name, one in chosen.items()))
    placed = place(own, source.crs, crs, photos)
    steps = (listed.steps[0] * (METRES_OF_A_DEGREE if placed.in_degrees else 1.0), listed.steps[1])
    good = [
        standard_errors(one, (source.sigma_plan, source.sigma_height), steps, bare)
        for one, bare in zip(own.positions, placed.without_height, strict=True)
    ]
    rows = zip(own.positions, placed.xyz.tolist(), attitudes(own, placed, crs), good, strict=True)
    by_name = {one.name: _update(one, xyz, angles, errors, placed, listed.heights) for one, xyz, angles, errors in rows}
    remarks = [PhotoRemark(code=PhotoRemarkCode.POSITION_WITHOUT_PHOTOGRAPH, photos=absent)] if absent else []
    read = _read(listed, own, placed, matched).model_copy(
        update={
            "encoding": encoding_of(text),
            "defaults": (source.sigma_plan, source.sigma_height) if any(map(_unstated, own.positions)) else None,
            "unstated": sum(map(_unstated, own.positions)),
            "raised": sum(errors.raised for errors in good),
            "rounded_m": max(steps) if any(errors.rounded for errors in good) else None,
        }
    )
    return FromFile([photo.model_copy(update=by_name.get(photo.name, {})) for photo in photos], remarks, read, placed.heights)


def _has_place(one: ListedPosition, crs: str) -> bool:
    """Whether a line holds a place: where there is no solution, it says only that the shutter was released, and receivers without
    one are at 0, 0."""
    return one.fix != "none" and (crs == ANY_CRS or one.xyz[:2] != (0.0, 0.0))


def _unstated(one: ListedPosition) -> bool:
    return one.sigma is None and one.fix not in ("float", "single")


def _by_event(listed: PositionList, photos: list[Photo]) -> Matched:
    """Exposures without names by the photographs that they belong to. Raises WorkflowError."""
    return match_events(list(listed.positions), photos, lambda events: _degrees(listed, events))


def _degrees(listed: PositionList, events: list[ListedPosition]) -> np.ndarray:
    """Longitude and latitude (n, 2) of exposures."""
    points = np.array([one.xyz for one in events])
    if listed.degrees:
        return points[:, :2]
    return np.column_stack(Transformer.from_crs(listed.crs, "EPSG:4979", always_xy=True).transform(*points.T)[:2])


def _by_name(listed: PositionList, photos: list[Photo]) -> tuple[Matched, tuple[str, ...]]:
    """The lines by the names of their photographs, and the names that no photograph has. Raises WorkflowError."""
    names = PhotographNames(photo.name for photo in photos)
    found = [(names.find(one.name), one) for one in listed.positions]
    absent = tuple(photo_stem(one.name) for name, one in found if name is None)
    # Photographs are dropped, and their lines stay: but where all of them are gone, the names are wrong.
    if len(absent) == len(found):
        raise WorkflowError(
            f"The positions file names none of the photographs: it has {some_of(absent, 3)}, the project has "
            f"{some_of([photo.name for photo in photos], 3)}; correct its names, or set positions: {{kind: none}}."
        )
    of_photo: dict[str, ListedPosition] = {}
    for name, one in found:
        if name is not None and of_photo.setdefault(name, one) is not one:
            raise WorkflowError(
                f"Lines {of_photo[name].line} and {one.line} of the positions file both mean the photograph {name}; keep one."
            )
    return Matched(of_photo, "name", None), absent


def _update(
    one: ListedPosition,
    xyz: list[float],
    angles: Triple | None,
    errors: Deserved,
    placed: PlacedPositions,
    stated: HeightKind | None,
) -> dict[str, object]:
    """What a photograph learns from its line."""
    found: dict[str, object] = {
        "position": (xyz[0], xyz[1], xyz[2]),
        "position_sigma": errors.sigma,
        "fix": one.fix,
        "height_kind": _kind(placed) or stated,
    }
    return found if angles is None else found | {"attitude": angles, "attitude_of": "file"}


def _kind(placed: PlacedPositions) -> HeightKind | None:
    """What the heights of placed positions refer to."""
    name = placed.heights.target if placed.heights.transformed else placed.heights.system
    return None if name is None else "ellipsoidal" if name.startswith("ellipsoid") else "sea_level"


def _read(listed: PositionList, own: PositionList, placed: PlacedPositions, matched: Matched) -> PositionsRead:
    return PositionsRead(
        format=listed.format,
        positions=len(listed.positions),
        used=len(own.positions),
        crs=placed.crs if len(placed.crs) < LONGEST else f"{CRS.from_user_input(placed.crs).name}",
        by=placed.by,
        matched=matched.by,
        confirmed=matched.confirmed,
        exchanged=placed.exchanged,
        without=listed.without + len(matched.of_photo) - len(own.positions),
        heights_of_tags=sum(placed.without_height),
        off_tags_m=placed.off_tags.plan,
        moved=placed.off_tags.moved,
        above_tags_m=placed.off_tags.above,
        stepped=placed.off_tags.stepped,
        angles=listed.angles,
        antenna=listed.antenna,
    )
