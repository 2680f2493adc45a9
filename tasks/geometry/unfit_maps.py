"""Maps on which nothing can be measured: a metre of theirs is none on the ground, as on web maps."""

import numpy as np
from pyproj import CRS, Transformer

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.map_scale import is_unfit, map_scale, unfit_sentence
from orthomill.tasks.geometry.reference_system import ground_crs
from orthomill.tasks.geometry.topocentric import degrees_of


def scale_at(xy: np.ndarray, crs: str) -> float:
    """Metres of the project's map to a metre on the ellipsoid at a place (2,); 1 where the projection has no inverse."""
    longitude, latitude = _degrees(xy, crs)
    return map_scale(ground_crs(crs), longitude, latitude).factor if np.isfinite([longitude, latitude]).all() else 1.0


def _degrees(xy: np.ndarray, crs: str) -> np.ndarray:
    to_map = Transformer.from_crs(CRS.from_epsg(4326), ground_crs(crs), always_xy=True)
    return degrees_of(to_map, np.asarray(xy, float)[None])[0]


def refuse_unfit_place(xy: np.ndarray, crs: str) -> None:
    """Raises WorkflowError where a metre of the map at a place (2,) is none on the ground."""
    factor = scale_at(xy, crs)
    if is_unfit(factor):
        raise WorkflowError(unfit_sentence(crs, ground_crs(crs), factor, *_degrees(xy, crs)))
