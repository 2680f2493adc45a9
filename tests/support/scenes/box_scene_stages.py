"""The box scene as stages: what simulation, photos, orientation and densification would leave behind, without their work."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from box_scene import CENTRES, DSM, ORTHO, Vehicle, block, heights, render, sees, true_ortho, view

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import Stage
from orthomill.schemas.surface import (
    COUNT,
    HEIGHT,
    PRECISION,
    PROVENANCE,
    RELATIVE_PRECISION,
    SURFACE,
    Provenance,
    Surface,
    SurfacePoints,
    points_table,
)
from orthomill.schemas.truth import (
    TRUTH_BLOCK,
    TRUTH_BUILDING,
    TRUTH_GRID,
    TRUTH_GROUND,
    TRUTH_MATERIAL,
    TRUTH_ORTHO,
    TRUTH_READERS,
    TRUTH_SURFACE,
    TRUTH_VISIBILITY,
    Material,
)

VEHICLES = {"a": Vehicle((80, 85, 30, 33)), "b": Vehicle((30, 35, 90, 93)), "c": Vehicle((38, 43, 90, 93))}
GAINS = {"a": (1.1, 5.0), "b": (0.9, -6.0), "c": (1.0, 0.0), "d": (1.05, -3.0)}
VIGNETTING = 0.15


def photograph(name: str) -> np.ndarray:
    """uint8 photo with its own gain, offset, vignetting, noise and vehicle."""
    image = render(view(name), VEHICLES.get(name))
    rows, cols = image.shape[:2]
    r2 = ((np.arange(rows) - (rows - 1) / 2) ** 2)[:, None] + ((np.arange(cols) - (cols - 1) / 2) ** 2)
    r2 = r2 / (((rows - 1) / 2) ** 2 + ((cols - 1) / 2) ** 2)
    gain, offset = GAINS[name]
    noise = np.random.default_rng(ord(name)).normal(0, 2, image.shape)
    return np.clip(np.rint(image * (gain * (1 - VIGNETTING * r2))[..., None] + offset + noise), 0, 255).astype(np.uint8)


def truth_rasters() -> dict[str, np.ndarray]:
    """All truth rasters on ORTHO's grid; a road in the north where the vehicles stand."""
    x, y = ORTHO.centres(Window(0, 0, ORTHO.rows, ORTHO.cols))
    z = heights(ORTHO)
    material = np.full(z.shape, Material.OPEN_GROUND, np.uint8)
    material[(y > 88) & (y < 95), :] = Material.ROAD
    material[z > 0] = Material.ROOF
    points = np.column_stack([*(a.ravel() for a in np.meshgrid(x, y)), z.ravel()])
    bits = np.zeros(len(points), np.uint32)
    for i, name in enumerate(CENTRES):
        bits |= sees(view(name), points).astype(np.uint32) << np.uint32(i)
    return {
        TRUTH_SURFACE: z,
        TRUTH_GROUND: np.zeros(z.shape, np.float32),
        TRUTH_MATERIAL: material,
        TRUTH_BUILDING: (z > 0).astype(np.uint16),
        TRUTH_ORTHO: np.rint(true_ortho()).astype(np.uint8),
        TRUTH_VISIBILITY: bits.reshape(z.shape),
    }


def give_truth_grid() -> MapGrid:
    return ORTHO


def give_photo(name: str) -> np.ndarray:
    return photograph(name)


def give_heights(seed: int, hole: bool) -> dict[str, np.ndarray]:
    z = heights(DSM) + np.random.default_rng(seed).normal(0, 0.1, DSM.shape).astype(np.float32)
    if hole:
        z[10:16, 10:18] = np.nan
    known = np.isfinite(z)
    precision = np.where(known, np.float32(0.1), np.float32(np.nan))
    codes = np.where(known, Provenance.AGREED, Provenance.EMPTY).astype(np.uint8)
    return {
        HEIGHT: z.astype(np.float32),
        PRECISION: precision,
        RELATIVE_PRECISION: precision,
        COUNT: known.astype(np.uint8),
        PROVENANCE: codes,
    }


def give_points(window: Window) -> SurfacePoints:
    """A point at the centre of every cell."""
    x, y = (values.ravel() for values in np.meshgrid(*DSM.centres(window)))
    sigma, code = np.full(x.size, 0.1, np.float32), np.full(x.size, Provenance.AGREED, np.uint8)
    two, first = np.full(x.size, 2, np.uint8), np.ones(x.size, np.uint16)
    return SurfacePoints(x, y, heights(DSM)[window.slices].ravel().astype(np.float64), sigma, two, code, first)


def give_block() -> Block:
    return block()


def give_surface() -> Surface:
    return Surface(grid=DSM, height_low=-2.0, height_high=16.0)


def give_photos() -> Photos:
    return Photos(
        photos=tuple(Photo(name=n, path=f"{n}.png", width=420, height=420, bands=3, dtype="uint8", camera="test") for n in CENTRES)
    )


def _whole(name: str, grid: MapGrid, dtype: str, bands: int = 0, readers: tuple[str, ...] | None = None) -> RasterSpec:
    return map_raster(name, grid, dtype, "EPSG:2100", 256, bands=bands, readers=readers)


class GivenStage(Stage):
    """Stands for the stage named by `kind`."""

    title: ClassVar[str] = "given"
    kind: str
    hole: bool = True

    def plan(self, view) -> Iterator[RasterSpec | Job]:
        if self.kind == "densification":
            yield from self._densification(view.project.tile)
        else:
            yield from getattr(self, f"_{self.kind}")()

    def _simulation(self) -> Iterator[RasterSpec | Job]:
        types = {
            TRUTH_SURFACE: "float32",
            TRUTH_GROUND: "float32",
            TRUTH_MATERIAL: "uint8",
            TRUTH_BUILDING: "uint16",
            TRUTH_ORTHO: "uint8",
            TRUTH_VISIBILITY: "uint32",
        }
        specs = [_whole(name, ORTHO, dtype, 3 if name == TRUTH_ORTHO else 0, TRUTH_READERS) for name, dtype in types.items()]
        yield from specs
        writes: dict[str, Raster | Table] = {spec.name: Raster(spec.name, spec.full) for spec in specs}
        yield Job(stage="simulation", item="truth", function=truth_rasters, reads={}, writes=writes)
        yield Job(stage="simulation", item="grid", function=give_truth_grid, reads={}, writes={"grid": TRUTH_GRID})
        yield Job(stage="simulation", item="block", function=give_block, reads={}, writes={"block": TRUTH_BLOCK})

    def _photos(self) -> Iterator[RasterSpec | Job]:
        yield Job(stage="photos", item="table", function=give_photos, reads={}, writes={"photos": PHOTOS})
        for name in CENTRES:
            spec = RasterSpec(name=photo_raster(name), shape=(420, 420, 3), dtype="uint8", chunk=420)
            yield spec
            yield Job(
                stage="photos",
                item=name,
                function=give_photo,
                reads={},
                writes={"pixels": Raster(spec.name, spec.full)},
                params={"name": name},
            )

    def _orientation(self) -> Iterator[RasterSpec | Job]:
        yield Job(stage="orientation", item="block", function=give_block, reads={}, writes={"block": BLOCK})

    def _densification(self, size: int) -> Iterator[RasterSpec | Job]:
        yield Job(stage="densification", item="grid", function=give_surface, reads={}, writes={"surface": SURFACE})
        types = {HEIGHT: "float32", PRECISION: "float32", RELATIVE_PRECISION: "float32", COUNT: "uint8", PROVENANCE: "uint8"}
        specs = [_whole(name, DSM, dtype) for name, dtype in types.items()]
        yield from specs
        yield Job(
            stage="densification",
            item="heights",
            function=give_heights,
            reads={},
            writes={s.name: Raster(s.name, s.full) for s in specs},
            params={"seed": 5, "hole": self.hole},
        )
        for tile in tiles_of(DSM.shape, size):
            points = {"points": points_table(tile.row, tile.col)}
            yield Job(
                stage="densification",
                item="points",
                function=give_points,
                reads={},
                writes=points,
                params={"window": tile.window},
                row=tile.row,
                col=tile.col,
            )


GIVEN = tuple(GivenStage(kind=kind) for kind in ("simulation", "photos", "orientation", "densification"))
