"""A pair of epipolar images with known heights: village texture on relief with box and gabled buildings, rendered by ray casting.

Real geometry (normal case, c, base, flying height), true occlusion, noise, gain and offset; numbers are near those of the flight
1:6800 reduced to 0.65 m on the ground, base over height 0.565.

The same pair over level ground, not rendered: there the parallax of every height is known in closed form.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from scipy import ndimage

from orthomill.schemas.camera import Camera
from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.gridding import HeightCells
from orthomill.tasks.densification.height_stack import HeightStack
from orthomill.tasks.densification.surface_tile import PairPiece, SurfaceTile
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window, nodes_shape

TEXTURE = Path(__file__).parents[4] / "shared" / "data" / "texture" / "village_mosaic.jpg"
CELL = 0.5
"""of the height grid and of the texture, m"""


@dataclass(frozen=True)
class Scene:
    """Heights and grey values on a grid of CELL; x = col * CELL, y = -row * CELL. `roof` marks buildings."""

    height: np.ndarray
    grey: np.ndarray
    roof: np.ndarray
    blank: np.ndarray
    """the pond"""


@dataclass(frozen=True)
class RenderedPair:
    """Both images, the geometry, and per left pixel the true ground point; `wall` marks pixels that show a wall."""

    pair: EpipolarPair
    left: np.ndarray
    right: np.ndarray
    xyz: np.ndarray
    parallax: np.ndarray
    roof: np.ndarray
    wall: np.ndarray
    blank: np.ndarray


def village(size: int = 1400, buildings: int = 40, seed: int = 3) -> Scene:
    """A scene of `size` cells a side: relief of about 12 m, buildings of 4 to 25 m, a pond without texture."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:size, 0:size] * CELL
    height = 6.0 * np.sin(x / 90.0) * np.cos(y / 70.0) + 0.01 * x
    grey, roof = _texture(size, rng), np.zeros((size, size), bool)
    for _ in range(buildings):
        _build(height, grey, roof, rng)
    blank = (x - x.mean()) ** 2 + (y - y.mean() * 0.6) ** 2 < 25.0**2
    height[blank], grey[blank], roof[blank] = height[blank].min(), 70.0, False
    return Scene(height.astype(np.float32), grey.astype(np.float32), roof, blank)


def _texture(size, rng):
    if TEXTURE.exists():
        import cv2

        whole = cv2.imread(str(TEXTURE), cv2.IMREAD_REDUCED_GRAYSCALE_2)
        part = whole[2500 : 2500 + int(size * 1.6), 2200 : 2200 + int(size * 1.6)]
        return cv2.resize(part, (size, size), interpolation=cv2.INTER_AREA).astype(np.float32)
    blocks = [np.kron(rng.normal(0, 9, (size // k + 1, size // k + 1)), np.ones((k, k)))[:size, :size] for k in (2, 4, 8, 16)]
    return sum(blocks) + 120.0


def _build(height, grey, roof, rng):
    """One building, turned against the axes, flat or gabled."""
    size = len(height)
    row, col = rng.integers(60, size - 60, 2)
    length, width, angle = rng.uniform(10, 26), rng.uniform(8, 14), rng.uniform(0, np.pi)
    y, x = np.mgrid[row - 50 : row + 50, col - 50 : col + 50]
    u = ((x - col) * np.cos(angle) + (y - row) * np.sin(angle)) * CELL
    v = ((y - row) * np.cos(angle) - (x - col) * np.sin(angle)) * CELL
    inside = (np.abs(u) < length / 2) & (np.abs(v) < width / 2)
    window = slice(row - 50, row + 50), slice(col - 50, col + 50)
    inside &= ~roof[window]
    eaves = height[window].mean() + rng.uniform(4, 25)
    gable = 0.6 * (width / 2 - np.abs(v)) if rng.random() < 0.6 else np.zeros_like(v)
    height[window][inside] = (eaves + gable)[inside]
    tiles = 100 + 50 * rng.random() + 12 * (gable > 0) * np.sign(v) + rng.normal(0, 10, v.shape) + 10 * np.sin(u * 3.0)
    grey[window][inside] = tiles[inside]
    roof[window] |= inside


def normal_case(size: int, c: float = 1597.0, base: float = 582.0, flying_height: float = 1040.0) -> EpipolarPair:
    """A pair that looks at the scene of `size` cells."""
    span = size * CELL
    low, high = c * base / (flying_height + 15.0), c * base / (flying_height - 60.0)
    pixels = int(span * c / flying_height) + 10
    left = (span / 2 - base / 2, -span / 2, flying_height)
    centre = pixels / 2
    return EpipolarPair(
        name="a-b",
        left="a",
        right="b",
        rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        left_centre=left,
        right_centre=(left[0] + base, left[1], left[2]),
        base=base,
        c=c,
        row0=centre,
        left_col0=centre - base / 2 * c / flying_height + 0.25,
        right_col0=centre + base / 2 * c / flying_height - 0.4,
        rows=pixels,
        left_cols=pixels,
        right_cols=pixels,
        parallax_low=low,
        parallax_high=high,
        base_height=base / flying_height,
        row_sigma=0.0,
    )


@njit(cache=True)
def _cast(height, origin, c, col0, row0, shape, top, bottom):
    """First hit of every pixel's ray: (rows, cols, 3), NaN beyond the scene; and whether it is a wall."""
    rows, cols = shape
    points, wall = np.full((rows, cols, 3), np.nan), np.zeros((rows, cols), np.bool_)
    step = 0.2
    for r in range(rows):
        for q in range(cols):
            dx, dy = (q - col0) / c, (row0 - r) / c
            before, z = 0.0, top
            while z > bottom:
                depth = origin[2] - z
                x, y = (origin[0] + dx * depth) / CELL, -(origin[1] + dy * depth) / CELL
                i, j = int(np.floor(y)), int(np.floor(x))
                if not (0 <= i < height.shape[0] - 1 and 0 <= j < height.shape[1] - 1):
                    break
                u, v = x - j, y - i
                a, b, d, e = height[i, j], height[i, j + 1], height[i + 1, j], height[i + 1, j + 1]
                if max(max(a, b), max(d, e)) - min(min(a, b), min(d, e)) > 2.0:
                    ground = height[int(y + 0.5), int(x + 0.5)]
                else:
                    ground = (a * (1 - u) + b * u) * (1 - v) + (d * (1 - u) + e * u) * v
                if ground >= z:
                    wall[r, q] = ground > z + 2.0 * step
                    share = 0.0 if z == top else (ground - z) / max(ground - z + before, 1e-9)
                    hit = z + (step * share if not wall[r, q] else 0.0)
                    points[r, q, 0], points[r, q, 1] = origin[0] + dx * (origin[2] - hit), origin[1] + dy * (origin[2] - hit)
                    points[r, q, 2] = hit
                    break
                before = z - ground
                z -= step
    return points, wall


def render(
    scene: Scene, pair: EpipolarPair, noise: float = 2.0, gain: float = 0.9, offset: float = 10.0, seed: int = 1
) -> RenderedPair:
    """Both images of the pair, rounded to grey values of 1 to 255, 0 beyond the scene."""
    import cv2

    rng = np.random.default_rng(seed)
    images, casts = [], []
    for centre, col0, factor, shift in (
        (pair.left_centre, pair.left_col0, 1.0, 0.0),
        (pair.right_centre, pair.right_col0, gain, offset),
    ):
        points, wall = _cast(scene.height, np.array(centre), pair.c, col0, pair.row0, (pair.rows, pair.left_cols), 60.0, -15.0)
        at = points[..., :2].astype(np.float32) / CELL * np.array([1, -1], np.float32)
        grey = cv2.remap(scene.grey, np.nan_to_num(at, nan=-1e4), None, cv2.INTER_CUBIC, borderValue=0)
        grey[wall] = 60.0
        grey = cv2.GaussianBlur(grey, (0, 0), 0.5) * factor + shift + rng.normal(0, noise, grey.shape)
        image = np.clip(np.rint(grey), 1, 255).astype(np.uint8)
        image[np.isnan(points[..., 0])] = 0
        images.append(image)
        casts.append((points, wall, at))
    points, wall, at = casts[0]
    near = np.nan_to_num(np.rint(at), nan=0).astype(int).clip(0, len(scene.roof) - 1)
    seen = np.isfinite(points[..., 0])
    roof, blank = (scene.roof[near[..., 1], near[..., 0]] & seen), (scene.blank[near[..., 1], near[..., 0]] & seen)
    parallax = pair.c * pair.base / (pair.left_centre[2] - points[..., 2])
    return RenderedPair(pair, images[0], images[1], points, parallax, roof, wall, blank)


def block_of(pair: EpipolarPair) -> Block:
    """The photographs of a pair, which are its epipolar images, as a block: vertical, each with the principal point of its
    image."""
    sides = ((pair.left, pair.left_centre, pair.left_col0), (pair.right, pair.right_centre, pair.right_col0))
    cameras = {
        name: Camera(
            name=name,
            width=pair.left_cols,
            height=pair.rows,
            c=pair.c,
            x0=col0 - (pair.left_cols - 1) / 2,
            y0=(pair.rows - 1) / 2 - pair.row0,
        )
        for name, _, col0 in sides
    }
    photos = tuple(ExteriorOrientation(photo=name, centre=centre, omega_phi_kappa=(0.0, 0.0, 0.0)) for name, centre, _ in sides)
    return Block(
        crs="EPSG:2100",
        cameras=cameras,
        of_photo={name: name for name in cameras},
        photos=photos,
        datum="free",
        sigma0_px=0.3,
        redundancy=9,
        iterations=1,
        ground_low=-10.0,
        ground_high=15.0,
    )


def photos_of(pair: EpipolarPair, levels: int = 2) -> Photos:
    """The table of the photographs of a pair."""
    size = {"width": pair.left_cols, "height": pair.rows, "bands": 1, "dtype": "uint8", "levels": levels}
    return Photos(photos=tuple(Photo(name=name, path=f"{name}.tif", camera=name, **size) for name in (pair.left, pair.right)))


LEVEL_SIZE = 220
STEP = 4
LEVEL_GRID = MapGrid(west=20.0, north=-20.0, cell=2.0, rows=32, cols=36)
"""well inside the ground that the pair sees, 0 to 110 m east and south"""


def level_pair(name: str = "a-b", **changes) -> EpipolarPair:
    """A pair with axes along the map: base 582 m, c 1597 px, flying height 1040 m."""
    return normal_case(LEVEL_SIZE).model_copy(update={"name": name, **changes})


def parallax_of(pair: EpipolarPair, z: np.ndarray | float) -> np.ndarray | float:
    """p = B c / (H - z), px."""
    return pair.base * pair.c / (pair.left_centre[2] - z)


def level_nodes(pair: EpipolarPair, z: float, window: Window, sigma: float = 0.1) -> np.ndarray:
    """Nodes (rows, cols, 3) of the plane of height `z` m: parallax, standard error, correlation."""
    values = np.array([parallax_of(pair, z), sigma, 0.9], np.float32)
    return np.broadcast_to(values, (*window.shape, 3)).copy()


def piece_of(pair: EpipolarPair, surface: Surface, work: Window) -> PairPiece:
    corners = box_corners(surface.grid, work.grown(1), surface.height_low, surface.height_high)
    return PairPiece(0, pair, node_window(pair, STEP, corners), STEP)


def surface_tile(*pairs: EpipolarPair, window: Window | None = None, work: Window | None = None) -> SurfaceTile:
    """A tile of LEVEL_GRID over the pairs; without windows the whole grid."""
    surface = Surface(grid=LEVEL_GRID, height_low=-30.0, height_high=60.0)
    whole = Window(0, 0, *LEVEL_GRID.shape)
    window, work = window or whole, work or whole
    return SurfaceTile(surface, window, work, tuple(piece_of(pair, surface, work) for pair in pairs), 10.0, 1.0)


def stack_of(*pairs: HeightCells, reference: float = 0.0, tolerance: float = np.inf) -> HeightStack:
    """The heights of pairs over the same cells, near a reference height (m); by default any height is near."""
    shape = pairs[0].height.shape
    stack = HeightStack.over(np.full(shape, reference), np.full(shape, tolerance, np.float32))
    for pair in pairs:
        stack.add(pair)
    return stack


def all_nodes(pair: EpipolarPair) -> Window:
    return Window(0, 0, *nodes_shape(pair, STEP))


def height_errors(scene: Scene, grid: MapGrid, heights: np.ndarray, around: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights (rows, cols) of a surface minus the truth, m, and bool: its cells of open ground, `around` cells or more from roofs
    and places without texture."""
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *grid.shape)))
    row, col = -y / CELL, x / CELL
    truth = ndimage.map_coordinates(scene.height, [row, col], order=1, mode="nearest")
    marked = ndimage.map_coordinates((scene.roof | scene.blank).astype(float), [row, col], order=0, mode="nearest") > 0
    inside = (col > 60) & (col < 360) & (row > 60) & (row < 360)
    return heights - truth, inside & ~ndimage.binary_dilation(marked, iterations=around)
