"""Heights of GPS tags in the vertical system of the project, and maps on which nothing can be measured.

Tags say what their heights refer to, or the workflow does; heights above the ellipsoid become those of the project's vertical
datum, where it has one. Heights of which nothing is known keep their values, and that is said.
"""

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.position_findings import HeightsOfPositions
from orthomill.schemas.photo import HeightKind, Photo
from orthomill.schemas.project import ANY_CRS
from orthomill.tasks.geometry.survey_system import refuse_unfit_place, survey_crs, transform_surveyed, vertical_name

_ELLIPSOIDAL = "EPSG:4979"


def with_heights_of_crs(photos: list[Photo], crs: str, stated: str | None) -> tuple[list[Photo], HeightsOfPositions | None]:
    """Photographs placed by their tags, with heights in the vertical datum of the project `crs`; `stated`: the system to which the
    workflow says that the heights belong. Raises WorkflowError where a grid is missing or `stated` names no heights."""
    placed = [photo for photo in photos if photo.position is not None and photo.longitude is not None]
    if not placed:
        return photos, None
    if stated is not None:
        _check_stated(stated)
    of_name = {photo.name: stated or (_ELLIPSOIDAL if photo.height_kind == "ellipsoidal" else None) for photo in placed}
    known = [photo for photo in placed if of_name[photo.name]]
    target = vertical_name(crs)
    system = stated or (_ELLIPSOIDAL if known else None)
    heights = HeightsOfPositions(
        system=vertical_name(system) if system else None,
        target=target,
        transformed=len(known) if target else 0,
        unknown=len(placed) - len(known),
    )
    if not known or system is None:
        return photos, heights
    # A local system has no place where a geoid could be looked up.
    if target and crs != ANY_CRS:
        degrees = np.array([(photo.longitude, photo.latitude, photo.position[2]) for photo in known if photo.position], float)
        above = transform_surveyed(degrees, system, crs)[0][:, 2]
    else:
        above = np.array([photo.position[2] for photo in known if photo.position])
    kind = _kind(target if target else vertical_name(system))
    moved = {photo.name: _at_height(photo, float(z), kind) for photo, z in zip(known, above, strict=True)}
    return [moved.get(photo.name, photo) for photo in photos], heights


def _check_stated(system: str) -> None:
    if vertical_name(system) is None:
        raise WorkflowError(
            f"positions > crs: {system} ({survey_crs(system).name}) says nothing of heights, and GPS tags are in WGS 84 "
            "anyway; give EPSG:4979 for heights above the ellipsoid, or EPSG:4326+5773 for heights above the sea."
        )


def _kind(name: str | None) -> HeightKind | None:
    return None if name is None else "ellipsoidal" if name.startswith("ellipsoid") else "sea_level"


def _at_height(photo: Photo, height: float, kind: HeightKind | None) -> Photo:
    x, y, _ = photo.position or (0.0, 0.0, 0.0)
    return photo.model_copy(update={"position": (x, y, height), "height_kind": kind})


def refuse_unfit_map(photos: list[Photo], crs: str) -> None:
    """Raises WorkflowError where a metre of the map is none on the ground, as on web maps."""
    placed = np.array([photo.position[:2] for photo in photos if photo.position is not None]).reshape(-1, 2)
    if len(placed):
        refuse_unfit_place(np.median(placed, axis=0), crs)
