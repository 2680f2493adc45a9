"""Control that lies beside its photographs by what another datum explains: ED50 for WGS 84 is 200 m off, too near for another site.

Every point is compared with the positions of the photographs in which it was measured; over a block the directions in which these
look cancel, more or less. Only an offset that vanishes with the datum of another system in common use is told.
"""

import numpy as np
from pyproj import CRS, Transformer
from pyproj.crs import ProjectedCRS
from pyproj.exceptions import CRSError, ProjError

from orthomill.schemas.findings.control_findings import DatumApart
from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ANY_CRS
from orthomill.tasks.geometry.reference_system import ground_crs
from orthomill.tasks.geometry.survey_system import plan_of, survey_crs

DATUMS = (4326, 4230, 4267, 4277, 4314, 4121, 4265, 4289, 4618, 4283, 4312, 4222)
"""Geographic systems whose datums lie 50 to 1000 m apart and are confused: WGS 84, ED50, NAD27, OSGB36, DHDN, GGRS87, Monte Mario,
Amersfoort, SAD69, GDA94, MGI, Cape"""
_POINTS, _SEEN = 3, 6
"""Points and measurements below which single photographs decide."""
_LEAST = 60.0
"""m: datums that are nearer to each other cannot be told apart by where photographs look"""
_LEFT = 0.35
"""of the offset may be left in the other system"""
_SURE = 3.0
"""standard errors of the mean offset"""


def datum_apart(
    surveyed: list[ControlPoint], given: np.ndarray, xyz: np.ndarray, photos: Photos, system: str, crs: str
) -> DatumApart | None:
    """The finding where points `xyz` (N, 3), `given` in a system, lie beside their photographs, and amid them on another datum."""
    if crs == ANY_CRS:
        return None
    offsets = _offsets(surveyed, xyz, photos)
    if len(offsets) < _POINTS or sum(len(one) for one in offsets) < _SEEN:
        return None
    means = np.array([one.mean(axis=0) for one in offsets])
    off, error = np.median(means, axis=0), means.std(axis=0, ddof=1).max() / np.sqrt(len(means))
    size = float(np.linalg.norm(off))
    if size < max(_LEAST, _SURE * error):
        return None
    rests = [(float(np.linalg.norm(off + shift)), name) for name, shift in _alternatives(given, xyz, system, crs)]
    left, name = min(rests, default=(np.inf, ""))
    return DatumApart(crs=system[:60], fits=name, distance_m=round(size, 1)) if left < _LEFT * size else None


def _offsets(surveyed: list[ControlPoint], xyz: np.ndarray, photos: Photos) -> list[np.ndarray]:
    """(m, 2) m for every point that was measured: how far it lies from the photographs that show it."""
    placed = {photo.name: np.array(photo.position[:2]) for photo in photos.photos if photo.position is not None}
    found = []
    for point, place in zip(surveyed, xyz, strict=True):
        own = [place[:2] - placed[name] for name in point.measurements if name in placed]
        found += [np.array(own)] if own else []
    return found


def _alternatives(given: np.ndarray, xyz: np.ndarray, system: str, crs: str) -> list[tuple[str, np.ndarray]]:
    """Other systems with the same projection on another datum, and by how much (2,) m they would move the points."""
    plane = survey_crs(plan_of(system))
    base = plane.geodetic_crs
    found = []
    for code in DATUMS:
        datum = CRS.from_epsg(code)
        if base is None or datum.equals(base):
            continue
        try:
            other = datum if plane.is_geographic else ProjectedCRS(plane.coordinate_operation, name=plane.name, geodetic_crs=datum)
            moved = Transformer.from_crs(other, ground_crs(crs), always_xy=True).transform(given[:, 0], given[:, 1])
        except (CRSError, ProjError):
            continue
        shift = np.median(np.column_stack(moved) - xyz[:, :2], axis=0)
        if np.isfinite(shift).all() and np.linalg.norm(shift) > _LEAST / 2:
            found.append((_name(other, datum), shift))
    return found


def _name(other: CRS, datum: CRS) -> str:
    """The code of a system, or the datum that makes it."""
    code = other.to_epsg(min_confidence=70)
    return f"EPSG:{code} ({datum.name})" if code else f"the same projection on {datum.name}"
