"""The jobs of one tile: its heights and its piece of orthoimage against the truth, or against files."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.evaluation.accuracy import JudgedCells, height_sums, histogram
from orthomill.tasks.evaluation.classes import PlaceClass, place_classes
from orthomill.tasks.evaluation.grids import Placement, codes_on, colours_on, heights_on
from orthomill.tasks.evaluation.orthoimage_accuracy import (
    NEAR_ROOF,
    GreyFit,
    GreySums,
    OrthoScene,
    channel_mean,
    count_ortho,
    fitted,
    grey_sums,
    is_ground,
    photos_that_reach,
    shifts,
)

UNKNOWN_COUNT = 255
"""Number of photos that see a place, where nobody knows it."""


def _inside(window: Window, core: Window) -> tuple[slice, slice]:
    return Window(core.row - window.row, core.col - window.col, core.height, core.width).slices


def _photo_count(visibility: np.ndarray, place: Placement) -> np.ndarray:
    """uint8 number of photos that truly see each judged cell; 255 beyond the truth."""
    bits = np.bitwise_count(visibility.astype(np.uint32)).astype(np.uint8)
    return codes_on(bits, place, UNKNOWN_COUNT)


def _judge(dh: np.ndarray, known: np.ndarray, cells: JudgedCells, building: np.ndarray, cell: float) -> dict[str, object]:
    """What the height jobs return, from arrays (rows, cols) and the flat judged cells."""
    measured = np.isfinite(cells.dh)
    in_building = np.isfinite(dh) & (building > 0) & known
    return {
        "dh": dh.astype(np.float32),
        "sums": height_sums(cells),
        "histogram": histogram(cells.dh[measured], cells.place[measured], cell),
        "buildings": histogram(dh[in_building], building[in_building], cell),
    }


def heights_against_truth(
    height: np.ndarray,
    precision: np.ndarray,
    surface: np.ndarray,
    material: np.ndarray,
    building: np.ndarray,
    visibility: np.ndarray,
    place: Placement,
    core: Window,
) -> dict[str, object]:
    """Judges the DSM cells `core`.

    height, precision (rows, cols) m at `core`; the truth rasters at the source window of `place`, whose window is `core` with a
    halo. Returns "dh" (rows, cols) float32, DSM minus truth, "sums", "histogram" per class, "buildings" per building's roof
    interior.
    """
    inner = _inside(place.window, core)
    true = heights_on(surface, place)[inner]
    classes = place_classes(codes_on(material, place))[inner]
    numbers = np.where(classes == PlaceClass.ROOF_INTERIOR, codes_on(building, place)[inner].astype(np.int64), 0)
    seen = _photo_count(visibility, place)[inner]
    known = np.isfinite(true) & (classes != PlaceClass.UNKNOWN)
    dh = height - true
    cells = JudgedCells(classes[known].astype(np.int64), dh[known], precision[known], seen[known] >= 2)
    return _judge(dh, known, cells, numbers, place.grid.cell)


def heights_against_file(height: np.ndarray, precision: np.ndarray, reference: np.ndarray, cell: float) -> dict[str, object]:
    """As `heights_against_truth`, with a reference (rows, cols) m on the same cells, NaN where it has none; all cells are one
    class."""
    known = np.isfinite(reference)
    dh = height - reference
    flat = np.full(int(known.sum()), int(PlaceClass.UNKNOWN), np.int64)
    cells = JudgedCells(flat, dh[known], precision[known], np.ones(len(flat), bool))
    return _judge(dh, known, cells, np.zeros(dh.shape, np.int64), cell)


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


def _hidden_photos(scene: OrthoScene, surface: np.ndarray, block: Block, grid: MapGrid) -> np.ndarray:
    """Photos that are kept from seeing a pixel by what stands in the way: on ground near roofs; -1 elsewhere; 0 on free ground."""
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
    return ndimage.distance_transform_edt(~mask) if mask.any() else np.full(mask.shape, np.inf)


def _finish(scene: OrthoScene, where: OrthoPlace, hidden: np.ndarray) -> dict[str, object]:
    inner = _inside(where.window, where.core)
    classes = place_classes(scene.material)
    difference = np.where(scene.judged[inner], channel_mean(scene.colour[inner] - scene.truth[inner]), np.nan)
    return {
        "counts": count_ortho(scene, where.core, hidden),
        "shifts": shifts(scene, where.core, classes),
        "difference": difference.astype(np.float32),
    }


def ortho_against_truth(
    ortho: np.ndarray,
    truth: np.ndarray,
    material: np.ndarray,
    visibility: np.ndarray,
    surface: np.ndarray,
    block: Block,
    fit: GreyFit,
    place: Placement,
    where: OrthoPlace,
) -> dict[str, object]:
    """Judges the ortho pixels `where.core`.

    ortho (rows, cols, 4) at `where.window`; the truth rasters at the source window of `place`; `block` is the true one. Returns
    "counts", "shifts" and "difference" (rows, cols) float32, mean over the channels of ortho (fitted) minus truth.
    """
    scene = OrthoScene(
        where.window,
        fitted(ortho, fit),
        colours_on(truth, place),
        ortho[..., 3] > 0,
        codes_on(material, place),
        _photo_count(visibility, place),
    )
    return _finish(scene, where, _hidden_photos(scene, heights_on(surface, place), block, where.grid))


def ortho_against_file(ortho: np.ndarray, reference: np.ndarray, fit: GreyFit, where: OrthoPlace) -> dict[str, object]:
    """As `ortho_against_truth`, with a reference (rows, cols, 3) on the same pixels and nothing known of materials and
    visibility."""
    nothing = np.zeros(ortho.shape[:2], np.uint8)
    scene = OrthoScene(where.window, fitted(ortho, fit), reference, ortho[..., 3] > 0, nothing, nothing + UNKNOWN_COUNT)
    return _finish(scene, where, np.full(ortho.shape[:2], -1))
