"""A box on a textured plane, photographed by exact ray casting: analytic truth for visibility and colour."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View, view_of

BOX = (50.0, 70.0, 52.0, 68.0, 14.0)
"""west, east, south, north, height, m"""
ROOF, WALL = np.array([200.0, 40.0, 40.0]), np.array([230.0, 0.0, 230.0])
DSM = MapGrid(west=0.0, north=120.0, cell=1.0, rows=120, cols=120)
ORTHO = MapGrid(west=0.0, north=120.0, cell=0.5, rows=240, cols=240)
CAMERA = Camera(name="test", width=420, height=420, c=400.0, x0=3.0, y0=-2.0, k1=-0.02, k2=0.004)
CENTRES = {"a": (20.0, 60.0, 200.0), "b": (60.0, 62.0, 205.0), "c": (104.0, 58.0, 198.0), "d": (61.0, 20.0, 202.0)}
SUBPIXEL = 4
"""rays along a pixel: a photograph of single rays has edges of whole pixels"""


@dataclass(frozen=True)
class Vehicle:
    """A flat coloured rectangle on the ground: west, east, south, north."""

    place: tuple[float, float, float, float]
    colour: tuple[float, float, float] = (250.0, 250.0, 20.0)


def block(names: str = "abcd") -> Block:
    """The named photos as an oriented block, slightly tilted."""
    photos = tuple(
        ExteriorOrientation(photo=name, centre=CENTRES[name], omega_phi_kappa=(1.0 - i, 0.5 * i, 10.0 * i))
        for i, name in enumerate(names)
    )
    return Block(
        crs="EPSG:2100",
        cameras={"test": CAMERA},
        of_photo=dict.fromkeys(names, "test"),
        photos=photos,
        datum="given",
        sigma0_px=0.1,
        redundancy=1,
        iterations=1,
        ground_low=0.0,
        ground_high=14.0,
    )


def view(name: str, names: str = "abcd") -> View:
    return view_of(block(names).of(name), CAMERA)


def heights(grid: MapGrid = DSM) -> np.ndarray:
    """float32 heights of the cells' centres."""
    x, y = grid.centres(_full(grid))
    inside = (x[None, :] > BOX[0]) & (x[None, :] < BOX[1]) & (y[:, None] > BOX[2]) & (y[:, None] < BOX[3])
    return np.where(inside, BOX[4], 0.0).astype(np.float32)


def _full(grid: MapGrid) -> Window:
    return Window(0, 0, grid.rows, grid.cols)


def ground_colour(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Smooth grass and fields, (..., 3), 60 to 160 grey levels."""
    wave = np.sin(x / 3.1) * np.cos(y / 4.3) + np.sin((x + 2 * y) / 9.0)
    return np.stack([100 + 20 * wave, 120 + 16 * wave, 80 + 12 * np.cos(x / 5.0 + wave)], axis=-1)


def hits_box(origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance along the rays (N, 3) to the box, inf where missed, and whether the roof is what is hit (slab method)."""
    low, high = np.array([BOX[0], BOX[2], 0.0]), np.array([BOX[1], BOX[3], BOX[4]])
    with np.errstate(divide="ignore", invalid="ignore"):
        t0, t1 = (low - origin) / direction, (high - origin) / direction
    near, far = np.minimum(t0, t1), np.maximum(t0, t1)
    entry, leave = near.max(axis=1), far.min(axis=1)
    hit = (entry < leave) & (entry > 1e-9)
    return np.where(hit, entry, np.inf), hit & (near[:, 2] >= near[:, :2].max(axis=1))


def sees(photo: View, points: np.ndarray) -> np.ndarray:
    """Brute force: whether the segment from each point (N, 3) to the projection centre misses the box and the photo contains the
    point."""
    direction = photo.centre - points
    start = points + 1e-6 * direction
    t, _ = hits_box(start, direction)
    inside = photo.contains(photo.project(points), 2.0)
    on_roof = points[:, 2] >= BOX[4] - 1e-9
    return inside & ((t > 1.0) | on_roof)


def render(photo: View, vehicle: Vehicle | None = None) -> np.ndarray:
    """The photograph, float64 (rows, cols, 3)."""
    camera = photo.camera
    col, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = photo.rays(np.column_stack([col.ravel(), row.ravel()]))
    t, roof = hits_box(np.broadcast_to(photo.centre, rays.shape), rays)
    ground = photo.centre + rays * (-photo.centre[2] / rays[:, 2])[:, None]
    colour = ground_colour(ground[:, 0], ground[:, 1])
    if vehicle is not None:
        w, e, s, n = vehicle.place
        colour[(ground[:, 0] > w) & (ground[:, 0] < e) & (ground[:, 1] > s) & (ground[:, 1] < n)] = vehicle.colour
    colour[np.isfinite(t)] = WALL
    colour[roof] = ROOF
    return colour.reshape(camera.height, camera.width, 3)


def sharp_photograph(name: str) -> np.ndarray:
    """The box as a camera sees it, uint8 (rows, cols, 3): every pixel the mean of many rays."""
    photo = view(name)
    finer = {key: getattr(photo.camera, key) * SUBPIXEL for key in ("width", "height", "c", "x0", "y0")}
    fine = replace(photo, camera=photo.camera.model_copy(update=finer))
    side = photo.camera.width
    return np.rint(render(fine).reshape(side, SUBPIXEL, side, SUBPIXEL, 3).mean(axis=(1, 3))).astype(np.uint8)


def true_ortho() -> np.ndarray:
    """float64 (rows, cols, 3) on ORTHO, without vehicles."""
    x, y = ORTHO.centres(_full(ORTHO))
    colour = ground_colour(*np.meshgrid(x, y))
    inside = (x[None, :] > BOX[0]) & (x[None, :] < BOX[1]) & (y[:, None] > BOX[2]) & (y[:, None] < BOX[3])
    colour[inside] = ROOF
    return colour
