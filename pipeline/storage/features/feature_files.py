"""Points, lines and polygons that a user has drawn, from GeoPackage, GeoJSON or CSV, in the project's system."""

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS, Transformer

from orthomill.pipeline.storage.features.geometry_files import Geometry, read_geometries, understood
from orthomill.schemas.accuracy.surface_answers import DrawnFeature, FeatureKind
from orthomill.schemas.errors import WorkflowError

_KINDS: dict[str, FeatureKind] = {"Point": "point", "LineString": "line", "Polygon": "polygon"}


def read_features(path: Path, crs: str) -> tuple[DrawnFeature, ...]:
    """All features of a file in the plan system `crs`. Raises WorkflowError for what cannot be read or holds none."""
    geometries = read_geometries(path, {".csv": _of_csv, ".txt": _of_csv}, ".gpkg, .geojson or .csv (name,x,y)")
    found = understood(path, lambda: tuple(_features(geometries, crs)))
    if not found:
        raise WorkflowError(f"{path} holds no points, lines or polygons.")
    for feature in found:
        if not np.isfinite(feature.places).all():
            raise WorkflowError(
                f"{path}: {feature.name} lies nowhere in {crs}: its coordinates are not of the system that the file has. A GeoJSON "
                'file without "crs" is in longitude and latitude; name the system in it, or give a GeoPackage.'
            )
        if len(feature.places) < {"point": 1, "line": 2, "polygon": 3}[feature.kind]:
            raise WorkflowError(f"{path}: {feature.name} is no {feature.kind}; it has {len(feature.places)} places.")
    return found


def _features(geometries: tuple[Geometry, ...], crs: str) -> Iterator[DrawnFeature]:
    for one in geometries:
        for kind, places in _parts(one.kind, one.coordinates):
            yield _moved(_feature(one.name, kind, places), one.system, crs)


def _moved(feature: DrawnFeature, system: str | None, crs: str) -> DrawnFeature:
    """The feature in another system."""
    own, target = CRS.from_user_input(system or crs), CRS.from_user_input(crs)
    if system is None or own == target:
        return feature
    plan = target.sub_crs_list[0] if target.is_compound else target
    change = Transformer.from_crs(own, plan, always_xy=True)
    places, *holes = (np.column_stack(change.transform(*ring.T)) for ring in (feature.places, *feature.holes))
    return DrawnFeature(feature.name, feature.kind, places, tuple(holes))


def _feature(name: str, kind: FeatureKind, places: Any) -> DrawnFeature:
    if kind != "polygon":
        return DrawnFeature(name, kind, _rows(places))
    outer, *holes = (ring[:-1] if len(ring) > 1 and np.array_equal(ring[0], ring[-1]) else ring for ring in map(_rows, places))
    return DrawnFeature(name, kind, outer, tuple(hole for hole in holes if len(hole) > 2))


def _rows(places: Any) -> np.ndarray:
    return np.array(places, np.float64).reshape(-1, np.shape(places)[-1])[:, :2]


def _of_csv(path: Path) -> Iterator[Geometry]:
    for number, row in enumerate(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()), 1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#") or (number == 1 and not _is_number(cells[-1])):
            continue
        # Behind x and y, lists of points have heights and standard errors, which are not asked for.
        name, *plan = cells[:3] if len(cells) > 2 else (str(number), *cells)
        if len(plan) != 2 or not all(map(_is_number, plan)):
            raise ValueError(f"line {number} is not name,x,y")
        yield Geometry(name, "Point", [float(value) for value in plan], None)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _parts(kind: str, places: Any) -> Iterator[tuple[FeatureKind, Any]]:
    """Single geometries; of polygons all rings."""
    if kind.startswith("Multi"):
        for one in places:
            yield from _parts(kind.removeprefix("Multi"), one)
    elif kind not in _KINDS:
        raise ValueError(f"geometries of kind {kind} are not measured")
    elif kind == "Polygon":
        yield "polygon", places
    else:
        yield _KINDS[kind], [places] if kind == "Point" else places
