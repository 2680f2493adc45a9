"""The points of a run as they are wanted: in another system, within an area or a cutline, a part at a time.

Points are records of LAS as they are stored, with coordinates in whole steps of the header: nothing is rounded twice, and a point
that is not moved keeps its numbers. Heights stay what they are; a system of another height reference is refused.
"""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs.known import LasZipVlr, WktCoordinateSystemVlr
from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError

from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.reference_systems import las_wkt
from orthomill.pipeline.storage.features.outline_files import Outline, moved, read_outlines
from orthomill.schemas.errors import StoreError, WorkflowError

PART = 500_000
"""points at a time"""
STEP, DEGREE_STEP = 0.001, 1e-8
"""of coordinates: a millimetre, in either"""


@dataclass(frozen=True)
class CloudSource:
    """Points of LAS or LAZ files; `header`: that of the file which is made of them, `plan`: WKT of its plan system, `bounds`: west,
    south, east and north of all points there."""

    files: tuple[Path, ...]
    header: laspy.LasHeader
    plan: str
    bounds: tuple[float, float, float, float]
    outlines: tuple[Outline, ...]
    area: tuple[float, float, float, float] | None
    change: Transformer | None

    def parts(self) -> Iterator[np.ndarray]:
        """(N,) records of LAS, with X, Y, Z in steps of the header."""
        for path in self.files:
            with laspy.open(path) as source:
                for points in source.chunk_iterator(PART):
                    if len(records := self._wanted(points)):
                        yield records

    def _wanted(self, points: laspy.ScaleAwarePointRecord) -> np.ndarray:
        x, y = np.asarray(points.x), np.asarray(points.y)
        if self.change:
            x, y = self.change.transform(x, y)
        keep = np.isfinite(x) & np.isfinite(y)
        if self.area:
            west, south, east, north = self.area
            keep &= (x >= west) & (x < east) & (y >= south) & (y < north)
        if self.outlines:
            keep[keep] = np.any([outline.contains(x[keep], y[keep]) for outline in self.outlines], axis=0)
        records = points.array[keep].copy()
        # Coordinates of the file itself are in its own steps, which may be others than those of the first file.
        for axis, values in enumerate((x[keep], y[keep], np.asarray(points.z)[keep])):
            steps = (values - self.header.offsets[axis]) / self.header.scales[axis]
            records["XYZ"[axis]] = np.rint(steps).astype(np.int32)
        return records


def cloud_source(files: tuple[Path, ...], wanted: Wanted) -> CloudSource:
    """The points of files as they are wanted. Raises WorkflowError and StoreError."""
    headers = [_header_of(path) for path in files]
    first = headers[0]
    if any(header.point_format != first.point_format for header in headers):
        raise StoreError(f"{files[0].name} and the files beside it have points of different kinds; export them one by one.")
    own = first.parse_crs()
    if own is None:
        raise StoreError(f"{files[0].name} names no reference system.")
    system = _system(wanted.crs, own) if wanted.crs else own
    plan = _plan(system).to_wkt()
    change = Transformer.from_crs(_plan(own), _plan(system), always_xy=True) if wanted.crs else None
    outlines = read_outlines(wanted.cutline, plan) if wanted.cutline else ()
    bounds = _bounds(headers, _plan(own).to_wkt(), plan)
    header = _target_header(first, system, bounds[:2] if wanted.crs else None)
    return CloudSource(files, header, plan, bounds, outlines, wanted.area, change)


def nothing_there() -> WorkflowError:
    """For files that would have no point."""
    return WorkflowError("No point lies in the area or cutline that is asked for.")


def as_points(header: laspy.LasHeader, records: np.ndarray) -> laspy.ScaleAwarePointRecord:
    """Records as laspy writes them."""
    return laspy.ScaleAwarePointRecord(records, header.point_format, header.scales, header.offsets)


def _header_of(path: Path) -> laspy.LasHeader:
    with laspy.open(path) as source:
        return source.header


def _system(text: str, own: CRS) -> CRS:
    try:
        asked = CRS.from_user_input(text)
    except CRSError as error:
        raise WorkflowError(f"--crs {text} is no reference system that PROJ knows; give a code such as EPSG:25832.") from error
    if asked.is_compound or len(asked.axis_info) == 3:
        raise WorkflowError(f"--crs {text} has heights of its own, and points keep theirs; give the plan system alone.")
    if own.is_compound:
        return CompoundCRS(f"{asked.name} + {own.sub_crs_list[1].name}", [asked, own.sub_crs_list[1]])
    return asked


def _plan(system: CRS) -> CRS:
    return system.sub_crs_list[0] if system.is_compound else system.to_2d()


def _bounds(headers: list[laspy.LasHeader], own: str, plan: str) -> tuple[float, float, float, float]:
    """West, south, east and north of all files in another system."""
    low, high = np.min([h.mins[:2] for h in headers], axis=0), np.max([h.maxs[:2] for h in headers], axis=0)
    ring = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]], [low[0], low[1]]])
    bounds = moved(Outline("", (ring,)), own, plan).bounds
    if not np.isfinite(bounds).all():
        raise WorkflowError("--crs is a system in which the points have no place; give one of their part of the world.")
    return bounds


def _target_header(source: laspy.LasHeader, system: CRS, corner: tuple[float, float] | None) -> laspy.LasHeader:
    header = deepcopy(source)
    if corner is not None:
        step = DEGREE_STEP if _plan(system).is_geographic else STEP
        header.scales, header.offsets = np.array([step, step, STEP]), np.array([*np.floor(corner), 0.0])
    header.vlrs = [vlr for vlr in source.vlrs if not isinstance(vlr, LasZipVlr | WktCoordinateSystemVlr)]
    header.vlrs.append(WktCoordinateSystemVlr(las_wkt(system.to_wkt())))
    header.evlrs = None
    header.partial_reset()
    return header
