"""Two photographs of which nothing is known: matched by region growing, and related by what has grown.

Strategy. Seeds are points that features of both photographs agree on, with the turn and the scale between them, or those of a list.
From these growth matches the nodes of a regular grid by least squares, free in both directions, so that neither an orientation nor
epipolar images are needed; a node that fewer than two neighbours predict is left out. The relative orientation is then that of the
textbooks, from a start by five points. Its standard errors hold what a camera without a calibration may be wrong by: camera
constant, principal point and distortion are moved and the pair is related again. Above the stages, which do not know each other.

Source: Otto & Chau 1989; Skarlatos (sources/matching.md#region-growing); Karfis 2009 (sources/epipolar.md#relative-orientation).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import GeometryError, OrthomillError, PhotoError
from orthomill.schemas.inspections.inspection import GrownPair, GrownUnknown
from orthomill.schemas.photo import Header
from orthomill.schemas.project import NoPositions
from orthomill.schemas.raster import Window
from orthomill.tasks.adjustment.solve.mixed_model import solve_mixed
from orthomill.tasks.calibration.report.known_cameras import from_exif
from orthomill.tasks.imagery.pyramid import halved
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.region_growing import Seeds, grow
from orthomill.tasks.orientation.relative.pair_precision import camera_effect, scatter
from orthomill.tasks.orientation.relative.relative_forms import dependent_form
from orthomill.tasks.orientation.relative.relative_orientation import orient_robust
from orthomill.tasks.photos.index import Limits, index_photos
from orthomill.tasks.tie_points.features import Detection, tile_features
from orthomill.tasks.tie_points.grown_search import feature_seeds, growth_of
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features

_ANY_SYSTEM = "EPSG:32631"
"""photographs without positions are in no system, but an index has one"""
_SEARCHED = 2000
"""px: longer side of the pyramid level on which features are looked for"""
_FEATURES, _CONTRAST, _RATIO = 4000, 0.02, 0.8
_RELATED = 3000
"""matches from which a pair is related; more of a smooth surface add nothing"""
UNCALIBRATED = 0.01
"""standard error of a camera that nobody calibrated: of its constant by itself, of the principal point by the longer side of the
frame, and of the place at the end of that side, which the lens distorts, by its distance from the middle"""
_NAMES = (("b_y / b_x", ""), ("b_z / b_x", ""), ("omega", "degrees"), ("phi", "degrees"), ("kappa", "degrees"))


@dataclass(frozen=True)
class GrowthRules:
    """How two photographs are matched: `step` px between nodes, `window` px along a side, and the camera constants (px) of left and
    right, None where they are not known."""

    step: int = 16
    window: int = 21
    constants: tuple[float, float] | None = None


def grown_pair(left: np.ndarray, right: np.ndarray, seeds: np.ndarray | None, rules: GrowthRules) -> GrownPair:
    """The matched nodes of two grey photographs (rows, cols) uint8, and their relative orientation where the camera is known.

    seeds: (S, 4) px, col and row on the left and on the right, or None: found by features. Raises PhotoError where no node grows,
    GeometryError where what has grown determines no orientation.
    """
    start = found_by_features(left, right) if seeds is None else Seeds(seeds[:, :2], seeds[:, 2:])
    if not len(start.points):
        raise PhotoError("The photographs show no common points by their features; give a list of seeds.")
    settings = growth_of(rules.window)
    part = ImagePart(left)
    grid = NodeGrid.within(part, rules.step, rules.window // 2 + 2)
    found = grow(part, ImagePart(right), grid, start, settings)
    matched = np.column_stack([found.reference, found.position])[found.converged]
    if not len(matched):
        raise PhotoError(
            f"Nothing grew from {len(start.points)} seeds: give seeds that are exact to two pixels, or a larger window."
        )
    sigma = np.sqrt(np.trace(found.covariance[found.converged], axis1=1, axis2=2) / 2.0)
    whole = GrownPair(seeds=len(start.points), nodes=len(grid.points()), matches=matched, sigma=sigma)
    return whole if rules.constants is None else related(whole, left.shape, right.shape, rules.constants)


def constants_of(headers: tuple[Header, Header]) -> tuple[float, float] | None:
    """The camera constants of two photographs by their tags, px; None where these do not tell."""
    try:
        photos = index_photos(headers, _ANY_SYSTEM, NoPositions(kind="none"), Limits(float("inf"))).photos
        known = from_exif(photos).cameras
    except OrthomillError:
        return None
    left, right = (known.cameras[known.of_photo[name]].c for name in photos.names)
    return left, right


def found_by_features(left: np.ndarray, right: np.ndarray) -> Seeds:
    """Points that features of both photographs (rows, cols) uint8 agree on, with the turn and the scale between them."""
    return feature_seeds(_features(left), _features(right), _RATIO)


def _features(image: np.ndarray) -> tuple[Features, np.ndarray]:
    """Features and descriptors (N, 128) of a photograph, on a level of its pyramid."""
    level, pixels = 0, image[:, :, None]
    while max(pixels.shape) > _SEARCHED:
        level, pixels = level + 1, halved(pixels)
    shape = pixels.shape[:2]
    found = tile_features(pixels, pixels, Detection(level, shape, Window(0, 0, *shape), _FEATURES, _CONTRAST))
    return found.features, found.descriptors.rows(DESCRIPTOR)


def related(pair: GrownPair, left: tuple[int, int], right: tuple[int, int], constants: tuple[float, float]) -> GrownPair:
    """The pair with its relative orientation; shapes (rows, cols) of the photographs, camera constants px. Raises GeometryError."""
    chosen = np.unique(np.linspace(0, len(pair.matches) - 1, _RELATED).astype(int))
    observations = np.column_stack([_from_centre(pair.matches[chosen, :2], left), _from_centre(pair.matches[chosen, 2:], right)])
    if len(observations) < 6:
        raise GeometryError(f"Only {len(observations)} nodes have grown; at least 6 are needed for a relative orientation.")
    robust = orient_robust(observations, *constants)
    # The dependent form divides by the base along x: photographs flown along y are turned by a quarter.
    turned = bool(abs(robust.solution.model.base[1]) > abs(robust.solution.model.base[0]))
    if turned:
        observations = observations[:, [1, 0, 3, 2]] * [1.0, -1.0, 1.0, -1.0]
        robust = orient_robust(observations, *constants)
    model = robust.solution.model
    kept = observations[robust.kept]
    solution = solve_mixed(dependent_form(model.base, model.rotation, *constants), kept)

    def orient(own: np.ndarray) -> np.ndarray:
        return solve_mixed(solution.model, own).model.unknowns

    spread, formal = scatter(kept, orient), solution.standard_errors**2
    own = formal if spread is None else np.maximum(formal, spread)
    frames, one_camera = (max(left), max(right)), constants[0] == constants[1]
    sigma = np.sqrt(own + camera_effect(list(other_cameras(kept, frames, one_camera)), orient, solution.model.unknowns))
    unknowns = tuple(
        GrownUnknown(name, unit, *(float(np.degrees(v) if unit else v) for v in values))
        for (name, unit), *values in zip(_NAMES, solution.model.unknowns, sigma, strict=True)
    )
    return GrownPair(
        seeds=pair.seeds,
        nodes=pair.nodes,
        matches=pair.matches,
        sigma=pair.sigma,
        related=len(observations),
        kept=int(robust.kept.sum()),
        sigma0_px=float(solution.sigma0),
        unknowns=unknowns,
        turned=turned,
    )


def other_cameras(matches: np.ndarray, frames: tuple[int, int], one_camera: bool) -> Iterator[np.ndarray]:
    """The matches (s, 4) px from the middle, as cameras would see them that are wrong by one standard error each in constant,
    principal point and distortion. frames: longer sides, px; one_camera: both photographs have the same errors."""
    for columns in ([0, 1, 2, 3],) if one_camera else ([0, 1], [2, 3]):
        for effect in (_constant, _aside, _above, _distortion):
            moved = matches.copy()
            for first in columns[::2]:
                own, side = slice(first, first + 2), frames[first // 2]
                moved[:, own] += UNCALIBRATED * effect(matches[:, own], side)
            yield moved


def _constant(places: np.ndarray, side: int) -> np.ndarray:
    return places


def _aside(places: np.ndarray, side: int) -> np.ndarray:
    return np.array([side, 0.0])


def _above(places: np.ndarray, side: int) -> np.ndarray:
    return np.array([0.0, side])


def _distortion(places: np.ndarray, side: int) -> np.ndarray:
    return places * (np.linalg.norm(places, axis=1, keepdims=True) / (side / 2.0)) ** 2


def _from_centre(pixels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Pixels (N, 2) (col, row) as image coordinates from the middle, y up."""
    return (pixels - (np.array(shape[::-1]) - 1) / 2.0) * [1.0, -1.0]
