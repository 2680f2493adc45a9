"""Products of another program at the check points of a project, whose photographs show where an orthoimage has them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.accuracy.acceptance import InspectedProducts
from orthomill.schemas.accuracy.point_tests import PointTest, PointTests
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.acceptance.delivered_points import STEEPEST, unpromised
from orthomill.tasks.accuracy.points.orthoimage_place import (
    GroundPlane,
    MarkedPatch,
    OrthoPixels,
    pixels_around,
    place_in_orthoimage,
)
from orthomill.tasks.accuracy.points.point_patches import patches_of
from orthomill.tasks.accuracy.points.surface_height import CellsAround, beside_survey, cells_around, height_at, on_even_ground
from orthomill.tasks.accuracy.points.under_vegetation import under_vegetation
from orthomill.tasks.geometry.view import block_view

Read = Callable[[MapGrid, Window], np.ndarray]


@dataclass(frozen=True)
class Inspector:
    """What a project knows: block, photographs and control, and `patch`, which reads a window of a level of a photograph; roles: of
    the points at which products are tested, the first one that any point has."""

    block: Block
    photos: Photos
    control: Control
    patch: Callable[[str, int, Window], np.ndarray]
    roles: tuple[str, ...] = ("check",)
    vegetated: tuple[str, ...] = ()
    """names or shell patterns of points under vegetation, where a surface shows crowns: stated apart"""

    def products(self, surface: tuple[MapGrid, Read] | None, ortho: tuple[MapGrid, Read] | None) -> InspectedProducts:
        """What the check points say of a surface (heights m) and an orthoimage (rows, cols, bands), as far as they are given.

        Raises WorkflowError for a pattern of `vegetated` that no point has.
        """
        of_roles = ([point for point in self.control.points if point.role == role] for role in self.roles)
        points = next(filter(None, of_roles), [])
        under = under_vegetation((point.name for point in points), self.vegetated)
        tests = tuple(self._test(point, surface, ortho).model_copy(update={"vegetated": point.name in under}) for point in points)
        grid = surface[0] if surface else None
        area = grid.rows * grid.cols * grid.cell**2 / 1e6 if grid else 0.0
        return unpromised(PointTests(points=tests, area_km2=area))

    def _test(self, point: ControlPoint, surface: tuple[MapGrid, Read] | None, ortho: tuple[MapGrid, Read] | None) -> PointTest:
        x, y, _ = point.xyz
        height = place = None
        if surface:
            grid, read = surface
            window = cells_around(grid, x, y).clipped(grid.shape)
            values = np.zeros((0, 0)) if window.empty else read(grid, window)
            height = height_at(CellsAround(grid, window, values, np.zeros(values.shape)), x, y, STEEPEST)
        if ortho:
            grid, read = ortho
            window = pixels_around(grid, x, y).clipped(grid.shape)
            pixels = np.zeros((0, 0, 3)) if window.empty else read(grid, window)
            patches = tuple(self._patches(point, grid.cell))
            place = on_even_ground(place_in_orthoimage(OrthoPixels(grid, window, pixels), patches, GroundPlane(point.xyz)), height)
        known = {"name": point.name, "surveyed": point.xyz, "sigma": point.sigma}
        return PointTest(**known, height=beside_survey(height, point.sigma[2]), place=place)

    def _patches(self, point: ControlPoint, cell: float) -> Iterator[MarkedPatch]:
        for at in patches_of(point, self.block, self.photos, cell):
            pixels = self.patch(at.photo, at.level, at.window)
            yield MarkedPatch(block_view(self.block, at.photo), point.measurements[at.photo], at.level, at.window, pixels)
