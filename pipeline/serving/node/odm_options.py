"""Options that clients know by OpenDroneMap's names, where they mean the same here, and what the others of a task are told.

A name is offered only where its meaning is kept; where it is kept in part, its help and the task's output say so.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from orthomill.pipeline.serving.node.offered_settings import NodeOption
from orthomill.schemas.errors import WorkflowError

QUALITIES = ("ultra", "high", "medium", "low", "lowest")
_SEARCHED = {"ultra": 6000, "high": 3000, "medium": 1500, "low": 1000, "lowest": 700}
"""px along the longer side: OpenDroneMap halves the photographs of a usual drone of 20 megapixels at each step"""
RERUN = "rerun-from"
_STAGES = {
    "dataset": "photos",
    "split": "photos",
    "opensfm": "tie_points",
    "openmvs": "epipolar",
    "odm_filterpoints": "densification",
    "odm_meshing": "densification",
    "odm_georeferencing": "densification",
    "odm_dem": "terrain",
    "mvs_texturing": "texture",
    "odm_orthophoto": "texture",
    "odm_report": "accuracy",
    "odm_postprocess": "accuracy",
}
"""stages here by those of OpenDroneMap that do the same"""


@dataclass
class Taken:
    """What the options of a task have asked for so far, in the terms of `Wishes`."""

    settings: dict[str, Any] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class OdmOption:
    """One of OpenDroneMap's names: how it is offered, and what it does."""

    offered: NodeOption
    take: Callable[[Any, Taken], None]


def _number(name: str, value: Any, low: float, high: float = math.inf, whole: bool = False) -> float:
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if isinstance(value, bool) or not low <= found <= high or not math.isfinite(found) or (whole and found != int(found)):
        kind = "a whole number" if whole else "a number"
        bounds = f"of at least {low:g}" if math.isinf(high) else f"from {low:g} to {high:g}"
        raise WorkflowError(f"{name} is {str(value)[:60]!r}; it is {kind} {bounds}.")
    return found


def truth(name: str, value: Any) -> bool:
    """True or false, as clients send it. Raises WorkflowError."""
    if isinstance(value, bool):
        return value
    text = str(value).strip().lower()
    if text in ("true", "1", "yes", ""):
        return True
    if text in ("false", "0", "no"):
        return False
    raise WorkflowError(f"{name} is {str(value)[:60]!r}; it is true or false.")


def _choice(name: str, value: Any, choices: tuple[str, ...]) -> str:
    if value not in choices:
        raise WorkflowError(f"{name} is {str(value)[:60]!r}; it is one of {', '.join(choices)}.")
    return str(value)


def _dtm(value: Any, taken: Taken) -> None:
    if not truth("dtm", value):
        taken.more["left_out"] = ("terrain",)


def _dsm(value: Any, taken: Taken) -> None:
    if not truth("dsm", value):
        taken.notes.append("dsm is false: the surface model is made all the same, for the orthoimage needs it.")


def _cog(value: Any, taken: Taken) -> None:
    if not truth("cog", value):
        taken.notes.append("cog is false: maps are cloud-optimised all the same; every program reads them as GeoTIFF.")


def _cell(name: str, target: str) -> Callable[[Any, Taken], None]:
    def take(value: Any, taken: Taken) -> None:
        taken.more[target] = _number(name, value, 0.0, 100_000) / 100

    return take


def _format(name: str, kind: str) -> Callable[[Any, Taken], None]:
    def take(value: Any, taken: Taken) -> None:
        if truth(name, value):
            taken.more["formats"] = (*taken.more.get("formats", ()), kind)

    return take


def _fast(value: Any, taken: Taken) -> None:
    if truth("fast-orthophoto", value):
        taken.settings.setdefault("epipolar.level", 2)
        taken.notes.append("fast-orthophoto: the surface is matched on photographs of a quarter of their size (epipolar.level 2).")


def _matched(value: Any, taken: Taken) -> None:
    taken.settings["epipolar.level"] = QUALITIES.index(_choice("pc-quality", value, QUALITIES))


def _searched(value: Any, taken: Taken) -> None:
    taken.settings["tie_points.search_side"] = _SEARCHED[_choice("feature-quality", value, QUALITIES)]


def _features(value: Any, taken: Taken) -> None:
    taken.settings["tie_points.max_features"] = int(_number("min-num-features", value, 200, 100_000, whole=True))


def _neighbours(value: Any, taken: Taken) -> None:
    if count := int(_number("matcher-neighbors", value, 0, 100, whole=True)):
        taken.settings["tie_points.nearest"] = max(count, 2)


def _gps(value: Any, taken: Taken) -> None:
    sigma = _number("gps-accuracy", value, 1e-4, 10_000)
    taken.settings |= {"positions.sigma_plan": sigma, "positions.sigma_height": sigma}


def _tiled(value: Any, taken: Taken) -> None:
    taken.more["tiled_cloud"] = truth("pc-ept", value)


def _shutter(value: Any, taken: Taken) -> None:
    if truth("rolling-shutter", value):
        taken.settings["orientation.variation.kind"] = "rolling_shutter"


def _readout(value: Any, taken: Taken) -> None:
    if milliseconds := _number("rolling-shutter-readout", value, 0.0, 1000):
        taken.more["readout"] = milliseconds / 1000


def _fixed(value: Any, taken: Taken) -> None:
    if truth("use-fixed-camera-params", value):
        taken.settings["orientation.interior"] = {"kind": "fixed"}


def _band(value: Any, taken: Taken) -> None:
    if value not in ("auto", "", None):
        taken.settings["photographs.band"] = str(value)[:40]


def _slope(value: Any, taken: Taken) -> None:
    taken.settings["terrain.slope"] = _number("smrf-slope", value, 1e-3, 2)


def _object(value: Any, taken: Taken) -> None:
    taken.settings["terrain.widest_object"] = 2 * _number("smrf-window", value, 1e-3, 500)


def _processes(value: Any, taken: Taken) -> None:
    taken.more["processes"] = int(_number("max-concurrency", value, 1, 100_000, whole=True))


def _boundary(value: Any, taken: Taken) -> None:
    if value in ("", None):
        return
    try:
        found = json.loads(value) if isinstance(value, str) else value
        points = tuple((float(x), float(y)) for x, y, *_ in _ring(found))
    except (ValueError, TypeError, KeyError, IndexError, OverflowError, AttributeError, RecursionError):
        points = ()
    if len(points) < 3 or not all(abs(x) <= 180 and abs(y) <= 90 for x, y in points):
        raise WorkflowError("boundary is no GeoJSON polygon in degrees (longitude, latitude) with three corners or more.")
    taken.more["boundary"] = points
    taken.notes.append("boundary: the surface is made within the extent of the polygon; maps are cut along it, points are not.")


def _ring(found: dict[str, Any]) -> list:
    """The outer ring of the first polygon."""
    if found["type"] == "FeatureCollection":
        return _ring(found["features"][0])
    if found["type"] == "Feature":
        return _ring(found["geometry"])
    ring = {"Polygon": lambda: found["coordinates"][0], "MultiPolygon": lambda: found["coordinates"][0][0]}
    return ring[found["type"]]()


def _option(
    name: str, kind: str, value: str, domain: str | tuple[str, ...], text: str, take: Callable[[Any, Taken], None]
) -> OdmOption:
    return OdmOption(NodeOption(name, kind, value, list(domain) if isinstance(domain, tuple) else domain, text), take)


_BOOL = ("bool", "false", "bool")
ODM_OPTIONS: dict[str, OdmOption] = {
    one.offered.name: one
    for one in (
        _option("dsm", "bool", "true", "bool", "The surface model. It is always made: the orthoimage needs it.", _dsm),
        _option("dtm", "bool", "true", "bool", "The terrain model, with its standard errors.", _dtm),
        _option(
            "orthophoto-resolution",
            "float",
            "0",
            "float >= 0",
            "Pixel of the orthoimage that is delivered (cm); 0, and what is finer than the photographs, is that of the product.",
            _cell("orthophoto-resolution", "ortho_cell"),
        ),
        _option(
            "dem-resolution",
            "float",
            "0",
            "float >= 0",
            "Cell of the height models that are delivered (cm); 0, and what is finer than was measured, is that of the product.",
            _cell("dem-resolution", "dem_cell"),
        ),
        _option("fast-orthophoto", *_BOOL, "Match the surface on photographs of a quarter of their size: faster, coarser.", _fast),
        _option(
            "pc-quality",
            "enum",
            "ultra",
            QUALITIES,
            "Size of the photographs that are matched: ultra as they are, high half, medium a quarter; where it is not given, the "
            "finest that the orientation allows.",
            _matched,
        ),
        _option(
            "feature-quality", "enum", "medium", QUALITIES, "Size of the photographs in which tie points are searched.", _searched
        ),
        _option("min-num-features", "int", "8000", "integer: 200 <= x <= 100000", "Points kept per photograph.", _features),
        _option(
            "matcher-neighbors",
            "int",
            "0",
            "integer: 0 <= x <= 100",
            "Photographs that each is compared with; 0: automatic.",
            _neighbours,
        ),
        _option("gps-accuracy", "float", "", "float > 0", "Standard error of the positions (m); empty: as the tags state.", _gps),
        _option("rolling-shutter", *_BOOL, "Photographs were exposed row by row by a moving camera.", _shutter),
        _option("rolling-shutter-readout", "float", "0", "float: 0 <= x <= 1000", "Time from first to last row (ms).", _readout),
        _option("use-fixed-camera-params", *_BOOL, "The interior orientation is not adjusted.", _fixed),
        _option("primary-band", "string", "auto", "string", "Of a multispectral camera, the band that makes the block.", _band),
        _option("smrf-slope", "float", "0.15", "float: 0 < x <= 2", "How much ground rises over the width of an object.", _slope),
        _option("smrf-window", "float", "30", "float: 0 < x <= 500", "Half the width of the widest building (m).", _object),
        _option("boundary", "string", "", "json", "GeoJSON polygon in degrees that maps are cut along.", _boundary),
        _option("max-concurrency", "int", "", "positive integer", "Worker processes at most.", _processes),
        _option("cog", "bool", "true", "bool", "Cloud-optimised GeoTIFFs. Maps are always such.", _cog),
        _option("pc-ept", "bool", "true", "bool", "The points as Entwine tiles too, for viewers of points.", _tiled),
        _option("orthophoto-png", *_BOOL, "The orthoimage as PNG as well.", _format("orthophoto-png", "png")),
        _option("gltf", *_BOOL, "The surface with the orthoimage on it as GLB.", _format("gltf", "glb")),
        _option("3d-tiles", *_BOOL, "The surface with the orthoimage on it as 3D Tiles.", _format("3d-tiles", "3dtiles")),
        _option("tiles", *_BOOL, "The orthoimage as tiles of the web (z/x/y) as well.", _format("tiles", "xyz")),
    )
}


def with_readout(taken: Taken) -> Taken:
    """The readout belongs to a rolling shutter: alone it means nothing."""
    more = dict(taken.more)
    readout = more.pop("readout", None)
    settings = dict(taken.settings)
    if readout is not None and settings.get("orientation.variation.kind") == "rolling_shutter":
        settings["orientation.variation.readout"] = readout
    return replace(taken, settings=settings, more=more)


def stage_of(name: str, kinds: tuple[str, ...]) -> str | None:
    """The stage that a client names to begin again from: one of ours, or the one that does the same as one of OpenDroneMap's."""
    if name in kinds:
        return name
    return found if (found := _STAGES.get(name)) in kinds else None


def stages_offered(kinds: tuple[str, ...]) -> NodeOption:
    """From where a task may begin again: by our names, and by those of OpenDroneMap, of which clients show a menu."""
    theirs = [name for name, stage in _STAGES.items() if stage in kinds]
    names = [*(kind for kind in kinds if kind in _STAGES.values()), *theirs]
    return NodeOption(RERUN, "enum", "", names, "Begin again at this stage; empty: at what is missing.")
