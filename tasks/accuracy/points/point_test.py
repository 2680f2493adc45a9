"""The job of one check point: surface, corrected surface, orthoimage and block beside what was surveyed."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.accuracy.point_tests import HeightTest, PlaceTest, PointTest
from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.orientation import Block, GroundResiduals
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.points.orthoimage_place import GroundPlane, MarkedPatch, OrthoPixels, place_in_orthoimage
from orthomill.tasks.accuracy.points.point_patches import PatchPlace
from orthomill.tasks.accuracy.points.surface_height import CellsAround, beside_survey, height_at, on_even_ground
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.visibility.monoplotting import point_covariance

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class PointPlace:
    """Where a point lies in the products: grids and clipped windows, None for products that are not there."""

    surface: MapGrid | None
    cells: Window | None
    ortho: MapGrid | None
    pixels: Window | None
    patches: tuple[PatchPlace, ...]


@dataclass(frozen=True)
class PointRules:
    """steepest: rise over run up to which heights are tested; vegetated: whether the point was marked as under vegetation."""

    steepest: float
    vegetated: bool


def point_beside_products(
    heights: tuple[np.ndarray, ...],
    corrected: tuple[np.ndarray, ...],
    terrain: tuple[np.ndarray, ...],
    ortho: tuple[np.ndarray, ...],
    photos: tuple[np.ndarray, ...],
    block: Block,
    ground: GroundResiduals,
    point: ControlPoint,
    place: PointPlace,
    rules: PointRules,
) -> PointTest:
    """One check point against everything that was made.

    heights: height, precision, provenance and precision of the datum at `place.cells`, or nothing; corrected: the heights after the
    check, or nothing; terrain: height and precision of the bare ground, or nothing; ortho: colours at `place.pixels`, or nothing;
    photos: a patch for each of `place.patches`.
    """
    own_test = _height_at(_heights(heights, place), point, rules) or _outside(place.surface)
    residual = next((r for r in ground.of_role("check") if r.name == point.name), None)
    return PointTest(
        name=point.name,
        surveyed=point.xyz,
        sigma=point.sigma,
        vegetated=rules.vegetated,
        height=beside_survey(own_test, point.sigma[2]),
        corrected=_height_at(_corrected(heights, corrected, place), point, rules),
        terrain=beside_survey(_height_at(_terrain(terrain, place), point, rules), point.sigma[2]),
        place=_place(ortho, photos, block, point, place, own_test),
        block=residual.difference if residual else None,
        block_predicted=residual.predicted if residual else None,
    )


def _height_at(cells: CellsAround | None, point: ControlPoint, rules: PointRules) -> HeightTest | None:
    return height_at(cells, *point.xyz[:2], rules.steepest) if cells else None


def _height_sigma(test: HeightTest | None) -> float:
    """What the surface states there, m; nothing where it states nothing."""
    return test.sigma if test and test.sigma is not None else 0.0


def _outside(grid: MapGrid | None) -> HeightTest | None:
    return None if grid is None else HeightTest(reason="outside of the surface")


def _heights(heights: tuple[np.ndarray, ...], place: PointPlace) -> CellsAround | None:
    if not heights or place.surface is None or place.cells is None:
        return None
    return CellsAround(place.surface, place.cells, *heights)


def _terrain(terrain: tuple[np.ndarray, ...], place: PointPlace) -> CellsAround | None:
    if not terrain or place.surface is None or place.cells is None:
        return None
    # Bridged ground is what is tested under vegetation: its code is no reason to leave it out.
    return CellsAround(place.surface, place.cells, *terrain)


def _corrected(heights: tuple[np.ndarray, ...], corrected: tuple[np.ndarray, ...], place: PointPlace) -> CellsAround | None:
    if not corrected or not heights or place.surface is None or place.cells is None:
        return None
    return CellsAround(place.surface, place.cells, corrected[0], *heights[1:])


def _place(
    ortho: tuple[np.ndarray, ...],
    photos: tuple[np.ndarray, ...],
    block: Block,
    point: ControlPoint,
    place: PointPlace,
    height: HeightTest | None,
) -> PlaceTest | None:
    if place.ortho is None:
        return None
    if not ortho or place.pixels is None:
        return PlaceTest(reason="outside of the orthoimage")
    patches = tuple(
        MarkedPatch(block_view(block, at.photo), point.measurements[at.photo], at.level, at.window, pixels)
        for at, pixels in zip(place.patches, photos, strict=True)
    )
    found = place_in_orthoimage(OrthoPixels(place.ortho, place.pixels, ortho[0]), patches, GroundPlane(point.xyz))
    promised = _promised(block, point, tuple(at.photo for at in place.patches), _height_sigma(height))
    return on_even_ground(found.model_copy(update={"promised": promised}), height)


def _promised(block: Block, point: ControlPoint, photos: tuple[str, ...], height_sigma: float) -> tuple[float, float] | None:
    """Standard errors of X and Y (m) that the orientations of the photographs and the height under them give a place in the
    orthoimage; their mean over the photographs, which share most of their errors."""
    known = [(name, block.of(name)) for name in photos]
    variances = []
    for name, orientation in known:
        if orientation.covariance is None:
            return None
        view, angles = block_view(block, name), tuple(np.radians(orientation.omega_phi_kappa))
        pixel = view.project(np.array([point.xyz]))[0]
        sigmas = 0.0, height_sigma
        found = point_covariance(view, np.array(orientation.covariance), angles, pixel, np.array(point.xyz), _UP, sigmas)
        variances.append(np.diag(found)[:2])
    if not variances:
        return None
    x, y = map(float, np.sqrt(np.mean(variances, axis=0)))
    return x, y
