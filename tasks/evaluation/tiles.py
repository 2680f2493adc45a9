"""The jobs of one tile: its heights and its part of the orthoimage against the truth, or against files."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED
from orthomill.schemas.truth import Material
from orthomill.tasks.evaluation.accuracy import HeightHistogram, HeightSums, JudgedCells, height_sums, histogram
from orthomill.tasks.evaluation.classes import CheckCounts, PlaceClass, check_counts, place_classes, strata
from orthomill.tasks.evaluation.edges import EdgeCounts, edge_counts, no_edges
from orthomill.tasks.evaluation.grids import Placement, codes_on, colours_on, heights_on
from orthomill.tasks.evaluation.orientation_accuracy import datum_heights
from orthomill.tasks.evaluation.orthoimage_accuracy import (
    NEAR_ROOF,
    GreyFit,
    GreySums,
    OrthoCounts,
    OrthoScene,
    Shifts,
    channel_mean,
    count_ortho,
    fitted,
    grey_sums,
    is_ground,
    photos_that_reach,
    shifts,
    with_datum,
)
from orthomill.tasks.evaluation.porous_crowns import CrownCells, CrownCounts, crown_counts, no_crowns

DATUM_NODES = 32
"""cells between the nodes at which the error of the datum is computed"""
UNKNOWN_COUNT = 255
"""code where the number of photographs that show a place is not known"""


class HeightComparison(NamedTuple):
    """A tile of heights: dh (rows, cols) float32 m, surface model minus reference; sums and histogram by stratum; histogram by
    building of its measured roof interior; heights at the edges of roofs, and in crowns."""

    dh: np.ndarray
    sums: HeightSums
    histogram: HeightHistogram
    buildings: HeightHistogram
    edges: EdgeCounts
    crowns: CrownCounts


class OrthoComparison(NamedTuple):
    """A tile of orthoimage: counts of pixels, shifts at nodes, and the difference (rows, cols) float32 grey levels, mean over the
    channels of the fitted orthoimage minus reference."""

    counts: OrthoCounts
    shifts: Shifts
    difference: np.ndarray


def _inside(window: Window, core: Window) -> tuple[slice, slice]:
    """`core` in arrays of `window`; both on the same grid."""
    return core.within(window).slices


def _photo_count(visibility: np.ndarray, place: Placement) -> np.ndarray:
    """uint8 number of photographs that truly show each judged cell; 255 beyond the truth."""
    # counted before resampling: bits of neighbouring cells must not be mixed
    bits = np.bitwise_count(visibility.astype(np.uint32)).astype(np.uint8)
    return codes_on(bits, place, UNKNOWN_COUNT)


class _ObjectCounts(NamedTuple):
    """Counts at objects of the scene."""

    edges: EdgeCounts
    crowns: CrownCounts


def _judge(dh: np.ndarray, cells: JudgedCells, building: np.ndarray, objects: _ObjectCounts, cell: float) -> HeightComparison:
    """The comparison from arrays (rows, cols), the flat judged cells and the counts at objects. `building`: 0 is not judged."""
    filled, in_building = np.isfinite(cells.dh), np.isfinite(dh) & (building > 0)
    return HeightComparison(
        dh=dh.astype(np.float32),
        sums=height_sums(cells, cell),
        histogram=histogram(cells.dh[filled], cells.stratum[filled], cell),
        buildings=histogram(dh[in_building], building[in_building], cell),
        edges=objects.edges,
        crowns=objects.crowns,
    )


def heights_against_truth(
    *,
    height: np.ndarray,
    precision: np.ndarray,
    relative: np.ndarray,
    provenance: np.ndarray,
    surface: np.ndarray,
    ground: np.ndarray,
    material: np.ndarray,
    building: np.ndarray,
    visibility: np.ndarray,
    block: Block,
    true_block: Block,
    place: Placement,
    core: Window,
) -> HeightComparison:
    """Compares the cells `core` of the surface model with the truth.

    height, precision, relative (rows, cols) m and provenance (code) at `core`; the truth rasters at the source window of `place`,
    whose window is `core` with a halo; the adjusted and the true block.
    """
    inner = _inside(place.window, core)
    # everything is resampled on the window with its halo and cropped afterwards: classes depend on the neighbourhood
    true, classes = heights_on(surface, place), place_classes(codes_on(material, place))
    edges = edge_counts(height, provenance, true, classes, place.grid.cell, inner)
    true, classes = true[inner], classes[inner]
    # roof interiors only: at the eaves the cell decides whether roof or ground is compared, not the height
    judged_roof = (classes == PlaceClass.ROOF_INTERIOR) & np.isin(provenance, MEASURED)
    numbers = np.where(judged_roof, codes_on(building, place)[inner].astype(np.int64), 0)
    twice = _photo_count(visibility, place)[inner] >= 2
    known = np.isfinite(true) & (classes != PlaceClass.UNKNOWN)
    dh = height - true
    datum = _datum_on(place.grid, core, block, true_block)
    cells = JudgedCells(strata(classes, provenance, twice)[known], dh[known], precision[known], relative[known], datum[known])
    trees = known & twice & (classes == PlaceClass.TREE)
    # Where the error of the datum is not known it is no reason to count nothing: it is centimetres, and surfaces are metres apart.
    own = height - np.nan_to_num(datum)
    rated = np.where(np.isfinite(datum), relative, np.nan)
    crowns = crown_counts(CrownCells(*(a[trees] for a in (provenance, own - true, own - heights_on(ground, place)[inner], rated))))
    return _judge(dh, cells, numbers, _ObjectCounts(edges, crowns), place.grid.cell)


def _datum_on(grid: MapGrid, core: Window, block: Block, truth: Block) -> np.ndarray:
    """What the adjusted orientations add to heights (rows, cols) m of `core`: bilinear between nodes of the whole grid."""
    # It changes by millimetres from node to node, and with the height of the ground by less: one level will do.
    first, last = (
        np.array([core.row, core.col]) // DATUM_NODES,
        -(-np.array([core.row + core.height, core.col + core.width]) // DATUM_NODES),
    )
    row, col = (DATUM_NODES * np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
    x, y = grid.west + (col + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell
    level = truth.ground_mean
    points = np.column_stack([*(a.ravel() for a in np.meshgrid(x, y)), np.full(len(x) * len(y), level)])
    nodes = datum_heights(block, truth, points).reshape(len(y), len(x))
    at = [np.arange(n) + start for n, start in ((core.height, core.row - row[0]), (core.width, core.col - col[0]))]
    return ndimage.map_coordinates(nodes, np.meshgrid(*(a / DATUM_NODES for a in at), indexing="ij"), order=1)


def heights_against_file(
    height: np.ndarray, precision: np.ndarray, provenance: np.ndarray, reference: np.ndarray, cell: float, sigma: float = 0.0
) -> HeightComparison:
    """As `heights_against_truth`, with a reference (rows, cols) m on the same cells, NaN where it has none, and its standard error
    (m); all cells are of one class."""
    known = np.isfinite(reference)
    dh = height - reference
    # visibility is not known, so every cell counts as visible in two photographs: completeness is then a lower bound
    stratum = strata(np.full(dh.shape, PlaceClass.UNKNOWN), provenance, np.ones(dh.shape, bool))
    # and the datum of a file is its own, so the precision among neighbours cannot be judged
    unknown = np.full(int(known.sum()), np.nan)
    # What is judged is the difference, which has the errors of both.
    cells = JudgedCells(stratum[known], dh[known], np.hypot(precision[known], sigma), unknown, unknown)
    return _judge(dh, cells, np.zeros(dh.shape, np.int64), _ObjectCounts(no_edges(), no_crowns()), cell)


def check_against_truth(code: np.ndarray, material: np.ndarray, place: Placement, core: Window) -> CheckCounts:
    """What the check says of the cells `core`, by class; code: uint8 CheckCode at `core`; other arguments as for the heights."""
    return check_counts(place_classes(codes_on(material, place))[_inside(place.window, core)], code)


def sums_against_truth(ortho: np.ndarray, truth: np.ndarray, place: Placement) -> GreySums:
    """Grey value sums of an ortho tile (rows, cols, 4) against the true orthoimage at the source window of `place`."""
    return grey_sums(ortho, colours_on(truth, place))


def sums_against_file(ortho: np.ndarray, reference: np.ndarray) -> GreySums:
    """Grey value sums of an ortho tile against a reference (rows, cols, 3) on the same pixels, NaN where it has none."""
    return grey_sums(ortho, reference)


@dataclass(frozen=True)
class OrthoPlace:
    """The pixels `core` of an ortho tile and the larger `window` that is read for it."""

    grid: MapGrid
    core: Window
    window: Window


@dataclass(frozen=True)
class OrthoTruthPlace(OrthoPlace):
    """The same with the placement of `window` in the truth."""

    source: Placement


def _hidden_photos(scene: OrthoScene, surface: np.ndarray, block: Block, grid: MapGrid) -> np.ndarray:
    """(rows, cols): photographs from which a pixel of ground near roofs is hidden; 0 on free ground, -1 elsewhere."""
    # Far from roofs nothing is projected: that ground is the control group, and it is by far the largest part.
    from_roof = _distance_to(scene.material == Material.ROOF)
    ground = is_ground(scene.material) & np.isfinite(surface) & (scene.seen != UNKNOWN_COUNT)
    near = ground & (from_roof <= NEAR_ROOF)
    hidden = np.where(ground & ~near, 0, -1)
    if near.any():
        x, y = grid.centres(scene.window)
        points = np.column_stack([*(a[near] for a in np.meshgrid(x, y)), surface[near]])
        hidden[near] = np.maximum(photos_that_reach(block, points) - scene.seen[near], 0)
    return hidden


def _distance_to(mask: np.ndarray) -> np.ndarray:
    """(rows, cols) px: distance to the nearest set pixel, inf where there is none."""
    return ndimage.distance_transform_edt(~mask) if mask.any() else np.full(mask.shape, np.inf)


def _finish(scene: OrthoScene, where: OrthoPlace, hidden: np.ndarray) -> OrthoComparison:
    inner = _inside(where.window, where.core)
    # classes of the whole window: a node at the edge of the tile has its neighbourhood in the halo
    classes = place_classes(scene.material)
    difference = np.where(scene.judged[inner], channel_mean(scene.colour[inner] - scene.truth[inner]), np.nan)
    return OrthoComparison(
        counts=count_ortho(scene, where.core, hidden),
        shifts=shifts(scene, where.core, classes),
        difference=difference.astype(np.float32),
    )


def ortho_against_truth(
    ortho: np.ndarray,
    truth: np.ndarray,
    material: np.ndarray,
    visibility: np.ndarray,
    surface: np.ndarray,
    height_source: np.ndarray,
    block: Block,
    adjusted: Block,
    fit: GreyFit,
    where: OrthoTruthPlace,
) -> OrthoComparison:
    """Compares the pixels `where.core` of the orthoimage with the truth.

    ortho (rows, cols, 4) and height_source (codes) at `where.window`; the truth rasters at the source window of `where.source`;
    `block` is the true one, `adjusted` that of the orthoimage.
    """
    place = where.source
    # the fit first: brightness is free in a block, and every later comparison is of grey values
    scene = OrthoScene(
        window=where.window,
        colour=fitted(ortho, fit),
        truth=colours_on(truth, place),
        covered=ortho[..., 3] > 0,
        material=codes_on(material, place),
        seen=_photo_count(visibility, place),
        source=height_source,
    )
    height = heights_on(surface, place)
    found = _finish(scene, where, _hidden_photos(scene, height, block, where.grid))
    return found._replace(shifts=with_datum(found.shifts, scene, where.grid, height, (adjusted, block)))


def ortho_against_file(
    ortho: np.ndarray, reference: np.ndarray, height_source: np.ndarray, fit: GreyFit, where: OrthoPlace
) -> OrthoComparison:
    """As `ortho_against_truth`, with a reference (rows, cols, 3) on the same pixels, without materials and visibility."""
    nothing = np.zeros(ortho.shape[:2], np.uint8)
    coloured = ortho[..., 3] > 0
    scene = OrthoScene(
        window=where.window,
        colour=fitted(ortho, fit),
        truth=reference,
        covered=coloured,
        material=nothing,
        seen=nothing + UNKNOWN_COUNT,
        source=height_source,
    )
    return _finish(scene, where, np.full(ortho.shape[:2], -1))
