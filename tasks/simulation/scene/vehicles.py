"""Vehicles: they are in other places in every photograph, as traffic is, and do not belong to the truth.

Most are drawn anew for every photo along roads and streets; some crawl and are a few metres further in the next photo, so that they
can be matched, at wrong heights. They are stamped into the height model and the colours of the window that is being rendered, so
that they occlude and are occluded like everything else.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import OPEN_MATERIALS
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow
from orthomill.tasks.simulation.scene.layout import STREET_SPACING, Scene
from orthomill.tasks.simulation.scene.scene import SurfaceWindow

FIRST_NUMBER = 60000
"""Vehicles have building numbers from here on while a photo is rendered."""
_REACH = 8  # m around a window: more than half the longest body plus its half width
_PER_VEHICLE = 45.0, 600.0  # m of country road, and m^2 of the town's radius squared, per vehicle
_CRAWLING, _CRAWL = 130.0, (0.8, 4.0)  # m of country road per crawling vehicle; m that it moves from photo to photo
_LANE = 0.48  # share of a road's half width: the middle of a lane
_WINDSCREEN = 0.25, 0.55  # from and to, in half lengths ahead of the middle
_PAINT = np.array(
    [
        [236.0, 236.0, 232.0],
        [206.0, 208.0, 210.0],
        [120.0, 122.0, 128.0],
        [34.0, 34.0, 38.0],
        [168.0, 34.0, 32.0],
        [40.0, 64.0, 120.0],
        [200.0, 178.0, 60.0],
    ]
)
_BODY = {"car": (4.4, 1.9, 1.5), "van": (5.8, 2.2, 2.3), "lorry": (9.5, 2.6, 3.3)}


def vehicles_of(scene: Scene, photo: int) -> np.ndarray:
    """(V, 10) vehicles of photo number `photo`: x, y, cos, sin, half length, half width, height (m), red, green, blue."""
    fast, slow = np.random.default_rng([scene.settings.seed, 3, photo]), np.random.default_rng([scene.settings.seed, 4])
    passing = np.concatenate([_on_roads(scene, fast), _on_streets(scene, fast)], axis=1)
    return np.concatenate([_bodies(passing, fast), _bodies(_crawling(scene, slow, photo), slow)])


def _bodies(places: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Rows of `vehicles_of` at places (3, N) x, y, heading."""
    x, y, angle = places
    bodies = np.array(list(_BODY.values()))[generator.choice(3, len(x), p=(0.74, 0.17, 0.09))]
    paint = _PAINT[generator.integers(0, len(_PAINT), len(x))]
    return np.column_stack([x, y, np.cos(angle), np.sin(angle), bodies[:, 0] / 2, bodies[:, 1] / 2, bodies[:, 2], paint])


def vehicle_cells(scene: Scene, grid: MapGrid, window: Window, photos: int) -> np.ndarray:
    """bool (rows, cols): cells of `window` on which a vehicle stands in one of the first `photos` photographs."""
    shape = window.shape
    height, building, free = np.zeros(shape, np.float32), np.zeros(shape, np.uint16), np.ones(shape, bool)
    colours, axes = np.zeros((*shape, 3), np.uint8), grid.centres(window)
    for photo in range(photos):
        # Colours are of no use here, but the kernel must be the one that draws the bodies in a photograph.
        vehicles = vehicles_of(scene, photo)
        near = _near(vehicles, axes)
        _stamp(height, building, colours, free, axes, vehicles[near], np.flatnonzero(near) + FIRST_NUMBER)
    return building > 0


def with_vehicles(painted: PaintedWindow, grid: MapGrid, window: Window, vehicles: np.ndarray) -> PaintedWindow:
    """The window with the vehicles (as from `vehicles_of`) on it."""
    height, building, colours = painted.surface.height.copy(), painted.surface.building.copy(), painted.colours.copy()
    axes = grid.centres(window)
    near = _near(vehicles, axes)
    # Only on bare ground: a vehicle below a crown or on a roof would change the truth that is evaluated there.
    free = np.isin(painted.surface.material, np.array(OPEN_MATERIALS, np.uint8))
    _stamp(height, building, colours, free, axes, vehicles[near], np.flatnonzero(near) + FIRST_NUMBER)
    return PaintedWindow(SurfaceWindow(height, painted.surface.material, building), colours)


def _near(vehicles: np.ndarray, axes: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Which vehicles may touch the cells with centres at x (cols,) and y (rows,)."""
    x, y = axes
    east, north = vehicles[:, 0], vehicles[:, 1]
    return (east > x[0] - _REACH) & (east < x[-1] + _REACH) & (north > y[-1] - _REACH) & (north < y[0] + _REACH)


def _on_roads(scene: Scene, generator: np.random.Generator) -> np.ndarray:
    """(3, N) x, y, heading of vehicles in either lane of country roads, one every 45 m on average."""
    return _in_lanes(scene, generator, _PER_VEHICLE[0], 0)


def _crawling(scene: Scene, generator: np.random.Generator, photo: int) -> np.ndarray:
    """(3, N) x, y, heading of the vehicles that crawl along country roads, where they are in photo number `photo`."""
    return _in_lanes(scene, generator, _CRAWLING, photo)


def _in_lanes(scene: Scene, generator: np.random.Generator, spacing: float, photo: int) -> np.ndarray:
    """(3, N) x, y, heading of vehicles, one every `spacing` m on average, after `photo` times the way of a crawling one."""
    s, rows = scene.settings, []
    for k, along_x in enumerate(scene.roads.along_x):
        low, high = (s.west, s.east) if along_x else (s.south, s.north)
        along = generator.uniform(low, high, max(int((high - low) / spacing), 3))
        side = np.where(generator.uniform(size=len(along)) < 0.5, -1.0, 1.0)
        # Traffic keeps to the right: the lane decides about the direction.
        along = along + (-side if along_x else side) * photo * generator.uniform(*_CRAWL, len(along))
        centre, slope = scene.roads.centre_line(k, along)
        across = centre + side * _LANE * scene.roads.half_width[k]
        turn = np.arctan(slope)
        rows.append(np.array([along, across, turn]) if along_x else np.array([across, along, np.pi / 2 - turn]))
    return np.concatenate(rows, axis=1)


def _on_streets(scene: Scene, generator: np.random.Generator) -> np.ndarray:
    """(3, N) x, y, heading of vehicles driving or parked in the streets of the town."""
    town = scene.town
    count = max(int(town.radius**2 / _PER_VEHICLE[1]), 12)
    along = generator.uniform(-town.radius, town.radius, count)
    side = np.where(generator.uniform(size=count) < 0.5, -1.0, 1.0) * generator.choice([1.3, 2.2], count)
    up = generator.uniform(size=count) < 0.5
    spacing = np.where(up, STREET_SPACING[0], STREET_SPACING[1])
    street = np.rint(generator.uniform(-town.radius, town.radius, count) / spacing) * spacing + side
    u, v = np.where(up, street, along), np.where(up, along, street)
    inside = np.hypot(u, v) < town.radius - 6.0
    x, y = town.world(u[inside], v[inside])
    return np.array([x, y, town.angle + np.where(up[inside], np.pi / 2, 0.0)])


@njit()
def _stamp(height, building, colours, free, axes, vehicles, numbers):
    """Lifts free cells under each vehicle to its roof; the windscreen is a dark band across it."""
    x, y = axes
    base = height.copy()  # two vehicles that overlap are not stacked
    cell = x[1] - x[0]
    for k in range(vehicles.shape[0]):
        cx, cy, cos, sin, length, width, tall, red, green, blue = vehicles[k]
        reach = np.sqrt(length * length + width * width)
        left, right = max(int((cx - reach - x[0]) / cell), 0), min(int((cx + reach - x[0]) / cell) + 2, len(x))
        top, bottom = max(int((y[0] - cy - reach) / cell), 0), min(int((y[0] - cy + reach) / cell) + 2, len(y))
        for row in range(top, bottom):
            for col in range(left, right):
                p = (x[col] - cx) * cos + (y[row] - cy) * sin
                q = (y[row] - cy) * cos - (x[col] - cx) * sin
                if free[row, col] and abs(p) <= length and abs(q) <= width:
                    height[row, col] = base[row, col] + np.float32(tall)
                    building[row, col] = numbers[k]
                    dark = 0.35 if _WINDSCREEN[0] * length < p < _WINDSCREEN[1] * length else 1.0
                    colours[row, col, 0] = np.uint8(red * dark)
                    colours[row, col, 1] = np.uint8(green * dark)
                    colours[row, col, 2] = np.uint8(blue * dark)
