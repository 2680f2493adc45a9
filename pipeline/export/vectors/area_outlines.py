"""Areas of equal codes of a raster as polygons, along the borders of its pixels, or of blocks of pixels where it is large."""

from collections.abc import Iterator

import numpy as np
import rasterio.features
from rasterio import Affine

from orthomill.pipeline.export.vectors.map_features import Feature, Layer
from orthomill.pipeline.painting.overview import overview
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.errors import StoreError
from orthomill.schemas.maps.coded_areas import CodedAreas

LONGEST = 4000
"""px along the longer side of the raster of which outlines are drawn"""
LEAST = 16
"""pixels or blocks of the smallest area: what is smaller is no seam that anybody looks for"""


def area_layer(name: str, store: ReadableStore, raster: str, areas: CodedAreas) -> Layer:
    """The areas of a raster of codes on the map, with the attributes of their codes and their size in m2.

    Raises StoreError when it does not lie on the map.
    """
    spec = store.spec(raster)
    if spec.transform is None:
        raise StoreError(f"{raster} does not lie on the map, so it has no areas there.")
    seen = overview(store, raster, LONGEST, nearest=True)
    codes = np.where(seen.share > 0, np.nan_to_num(seen.values), 0).astype(np.int32)
    place = Affine(*spec.transform) @ Affine.scale(seen.factor)
    return Layer(name, "area", tuple(_features(codes, place, areas)))


def _features(codes: np.ndarray, place: Affine, areas: CodedAreas) -> Iterator[Feature]:
    pixel = abs(place.a * place.e)
    known = np.isin(codes, list(areas.attributes))
    kept = rasterio.features.sieve(np.where(known, codes, 0).astype(np.int32), LEAST)
    found = [
        (int(code), [np.array(ring) for ring in shape["coordinates"]])
        for shape, code in rasterio.features.shapes(kept, mask=known & (kept > 0), transform=place)
    ]
    for code, rings in sorted(found, key=lambda item: (item[0], tuple(item[1][0][0]))):
        size = _area(rings[0]) - sum(map(_area, rings[1:]))
        if size < LEAST * pixel:
            continue
        outline, *holes = (np.column_stack([ring, np.zeros(len(ring))]) for ring in rings)
        yield Feature(outline, {"code": code, **areas.attributes[code], "area_m2": round(size, 2)}, holes=tuple(holes))


def _area(ring: np.ndarray) -> float:
    x, y = ring[:, 0] - ring[0, 0], ring[:, 1] - ring[0, 1]
    return float(abs(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1])) / 2)
