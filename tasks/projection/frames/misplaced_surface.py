"""A surface that the photographs cannot have been taken of: beside all frames, far behind the object, or in another unit.

Every sentence tells by how far or by how many times it misses, and what to do.
"""

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.geometry.view import View

_UNITS = {1000.0: "mm", 100.0: "cm"}
_FITTING, _LEAST_SIZE = 0.2, 50.0
"""part of the surface that photographs show where it has the right unit, and its least size in their pixels"""
_NOTHING = 20.0
"""pixels across a surface below which it cannot be what was photographed"""


def shown_by(views: tuple[View, ...], points: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """bool (N,): points that lie in some photograph, hidden or not; and of each photograph the median side of a pixel there, m."""
    shown, sizes = np.zeros(len(points), bool), []
    for view in views:
        inside = view.contains(view.project(points))
        shown |= inside
        if inside.any():
            sizes.append(float(np.median(np.linalg.norm(points[inside] - view.centre, axis=1))) / view.camera.c)
    return shown, sizes


def fitting_unit(views: tuple[View, ...], points: np.ndarray, share: float) -> str:
    """The unit in which the photographs would show much more of points (N, 3) than the `share` that they show in metres, or "".

    A surface a thousand times too large surrounds the photographs, which then show little of it, from inside.
    """
    some = points[:: max(len(points) // 5000, 1)]
    size, shares = float(np.linalg.norm(np.ptp(some, axis=0))), {"": 0.0}
    for factor, unit in _UNITS.items():
        shown, sizes = shown_by(views, some / factor)
        # Anything fits into a photograph if it is only small enough.
        shares[unit] = float(shown.mean()) if sizes and size / factor > _LEAST_SIZE * float(np.median(sizes)) else 0.0
    best = max(shares, key=lambda unit: shares[unit])
    return best if shares[best] > max(_FITTING, 3.0 * share) else ""


def why_unseen(census: MeshCensus, views: tuple[View, ...], share: float, fitting: str, unit: str) -> str:
    """Why the photographs show nothing of the mesh, or so little, in a sentence."""
    distance, spread = _apart(census, views)
    part = f"{100 * share:.0f} % of the surface is" if share else "None of the surface is"
    text = (
        f"{part} in the frame of any of the {len(views)} photographs: its middle lies {plain(distance)} m from theirs, which are "
        f"{plain(spread)} m apart, and it is {plain(census.size)} m large."
    )
    if fitting and unit != "auto":
        times = next(factor for factor, name in _UNITS.items() if name == fitting)
        return f"{text} It would fit {times:g} times smaller: is `unit: {unit}` right?"
    if fitting:
        return f"{text} In {fitting} it would fit: set `unit: {fitting}` (or `unit: m`, if it is right)."
    facing = np.mean([-(view.rotation[2] @ (census.middle - view.centre)) > 0 for view in views])
    if distance < 5 * max(spread, census.size) and facing < 0.5:
        return f"{text} The photographs look away from it: the rotations of the orientation are of another convention."
    return f"{text} The two are in different systems: give the `shift` of the mesh, or orient the photographs in its system."


def refuse_tiny(census: MeshCensus, views: tuple[View, ...], points: np.ndarray, sizes: list[float], unit: str) -> None:
    """Raises GeometryError where a surface with these points (N, 3) is so far away or so small that the photographs show nothing of
    it but a few pixels; sizes: of a pixel of the photographs on it, m."""
    pixels = census.size / float(np.median(sizes))
    if pixels >= _NOTHING:
        return
    distance, spread = _apart(census, views)
    count = "one triangle" if census.triangles == 1 else f"{census.triangles} triangles"
    text = (
        f"The surface ({count}) fills no more than {max(pixels, 0.1):.2g} pixels of the photographs: it is {plain(census.size)} m "
        f"large, and its middle lies {plain(distance)} m from theirs, which are {plain(spread)} m apart."
    )
    larger = next((factor for factor, name in _UNITS.items() if name == unit), None)
    if larger and float(shown_by(views, points * larger)[0].mean()) > _FITTING:
        raise GeometryError(f"{text} It would fit {larger:g} times larger: is `unit: {unit}` right?")
    if distance > 10 * max(spread, census.size):
        raise GeometryError(f"{text} It is far behind what they show: give the `shift` of the mesh, or orient them in its system.")
    raise GeometryError(f"{text} Give its `unit`, or the mesh of what was photographed.")


def _apart(census: MeshCensus, views: tuple[View, ...]) -> tuple[float, float]:
    """From the middle of the photographs to that of the surface, and across the photographs, m."""
    centres = np.array([view.centre for view in views])
    return float(np.linalg.norm(census.middle - centres.mean(axis=0))), float(np.linalg.norm(np.ptp(centres, axis=0)))


def plain(length: float) -> str:
    """A length in figures, without powers of ten where it is large."""
    return f"{length:.0f}" if length >= 1000 else f"{length:.4g}"
