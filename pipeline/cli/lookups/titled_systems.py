"""The reference system of a delivery in words: its plan part, what heights refer to, and whether it needs an epoch."""

from pathlib import Path

from pyproj import CRS
from pyproj.exceptions import CRSError

from orthomill.pipeline.storage.height_systems import horizontal, vertical
from orthomill.pipeline.storage.map_files import opened_map
from orthomill.pipeline.storage.point_files import is_point_file, points_system
from orthomill.schemas.accuracy.acceptance_record import SystemNames

NOT_STATED = "not stated"


def system_names(text: str) -> SystemNames:
    """Of a system as a project or a file names it; empty where PROJ does not know it."""
    try:
        crs = CRS.from_user_input(text)
    except CRSError:
        return SystemNames(plan=text)
    up = vertical(crs)
    return SystemNames(plan=_titled(horizontal(crs)), height=_titled(up) if up is not None else "", epoch=_epoch(crs))


def names_of_file(path: Path) -> SystemNames:
    """Of a raster or a point cloud. Raises WorkflowError for a file that is neither."""
    if is_point_file(path):
        return system_names(points_system(path, "EPSG:4326").whole.to_wkt())
    with opened_map(path, "EPSG:4326") as source:
        return system_names(source.crs.to_wkt()) if source.crs else SystemNames()


def _titled(crs: CRS) -> str:
    authority = crs.to_authority(min_confidence=70)
    return f"{crs.name} ({':'.join(authority)})" if authority else crs.name


def _epoch(crs: CRS) -> str:
    """Files of today state none: whether the frame moves against the ground says whether one is missing."""
    plan = horizontal(crs)
    geodetic = (plan.geodetic_crs or plan).to_json_dict()
    ensemble = geodetic.get("datum_ensemble")
    if ensemble:
        known = f"{ensemble['name']} is known to {ensemble['accuracy']} m only"
        return f"{NOT_STATED}; {known}: the survey has to name realization and epoch"
    if geodetic.get("datum", {}).get("type") == "DynamicGeodeticReferenceFrame":
        return f"{NOT_STATED}; coordinates move in this frame: the survey has to name their epoch"
    return "none needed: the frame moves with its ground"
