"""Where things stand in a simulated scene: relief, pond, roads, town, buildings and trees, all drawn once from a seed.

The layout is a handful of small arrays; what a window of the scene looks like follows from them and from world coordinates
alone (`scene.py`), so that any tile can be made by itself. Places are fractions of the scene's bounds and the relief grows with
the flying height, so that the same settings give a sensible scene for a block of two square kilometres or of a few hectares.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from schemas.errors import GeometryError

FULL_HEIGHT = 1043.0
"""m: the flying height (1:6800, c = 153.353 mm) for which relief and building heights below are stated."""
TREE_TOP = 12.5
"""m: no tree is higher above its ground."""
LOT_MARGIN = 3.0
STREET_SPACING = (64.0, 84.0)


@dataclass(frozen=True)
class SceneSettings:
    """What determines a scene completely. Bounds in m in the project's CRS."""

    seed: int
    west: float
    south: float
    east: float
    north: float
    flying_height: float
    buildings: int

    @property
    def scale(self) -> float:
        """Size of the relief against that of the full block."""
        return self.flying_height / FULL_HEIGHT

    @property
    def roof_top(self) -> float:
        """Greatest height of a roof above its ground, m."""
        return float(np.clip(25.0 * self.scale, 12.0, 25.0))

    def place(self, across: float, up: float) -> tuple[float, float]:
        """The point at a fraction of the width and of the height of the bounds."""
        return self.west + across * (self.east - self.west), self.south + up * (self.north - self.south)


@dataclass(frozen=True)
class Pond:
    """An ellipse of still water at one level, half axes `a` (east) and `b` (north), m."""

    x: float
    y: float
    a: float
    b: float
    level: float


@dataclass(frozen=True)
class Town:
    """A disc with a rectangular net of streets, turned by `angle` (radians)."""

    x: float
    y: float
    radius: float
    angle: float
    street_half_width: float

    def local(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World to the town's own axes, m."""
        dx, dy = x - self.x, y - self.y
        return dx * np.cos(self.angle) + dy * np.sin(self.angle), dy * np.cos(self.angle) - dx * np.sin(self.angle)

    def world(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The town's axes to the world, m."""
        return (self.x + u * np.cos(self.angle) - v * np.sin(self.angle),
                self.y + u * np.sin(self.angle) + v * np.cos(self.angle))


@dataclass(frozen=True, eq=False)
class Roads:
    """Country roads: sine curves along x (`along_x` true: y = f(x)) or along y. All (R,)."""

    along_x: np.ndarray
    offset: np.ndarray
    amplitude: np.ndarray
    wavenumber: np.ndarray
    phase: np.ndarray
    half_width: np.ndarray

    def centre_line(self, road: int, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The other coordinate of the centre line and its slope, at `along` (m)."""
        angle = self.wavenumber[road] * along + self.phase[road]
        return (self.offset[road] + self.amplitude[road] * np.sin(angle),
                self.amplitude[road] * self.wavenumber[road] * np.cos(angle))


@dataclass(frozen=True, eq=False)
class Buildings:
    """Rectangular houses, all (B,). `eaves` is the height of the eaves (m, absolute), `rise` that of the ridge above them (0: flat)."""

    x: np.ndarray
    y: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    half_length: np.ndarray
    half_width: np.ndarray
    eaves: np.ndarray
    rise: np.ndarray

    def __len__(self) -> int:
        return len(self.x)

    @property
    def table(self) -> np.ndarray:
        """(B, 8) float64 in the order of the fields, for kernels."""
        return np.column_stack([self.x, self.y, self.cos, self.sin, self.half_length, self.half_width, self.eaves, self.rise])


@dataclass(frozen=True, eq=False)
class Scene:
    """The layout of a scene."""

    settings: SceneSettings
    waves: np.ndarray
    """(W, 4): amplitude (m), wavenumbers along x and y (1/m), phase"""
    hills: np.ndarray
    """(H, 5): x, y, height, sigma along x and y (m)"""
    pond: Pond
    town: Town
    roads: Roads
    buildings: Buildings
    trees: np.ndarray
    """(T, 4): x, y, crown radius, top (m, absolute)"""
    tree_feet: np.ndarray
    """(T,): height of the ground under the tree, m"""


def terrain_factors(scene: Scene, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The relief as a sum of products: height(x, y) = sum over k of fx[k] * fy[k], before the pond is cut in.

    x (N,) and y (M,) m; returns fx (K, N) and fy (K, M). Waves and round hills separate; a window then costs no transcendental
    function per cell.
    """
    west, south = scene.settings.west, scene.settings.south
    fx, fy = [np.full(len(x), 1.0)], [_plain(scene, y)]
    for amplitude, kx, ky, phase in scene.waves:
        east, north = kx * (x - west) + phase, ky * (y - south)
        fx += [amplitude * np.sin(east), amplitude * np.cos(east)]
        fy += [np.cos(north), np.sin(north)]
    for hx, hy, height, sx, sy in scene.hills:
        fx.append(height * np.exp(-0.5 * ((x - hx) / sx) ** 2))
        fy.append(np.exp(-0.5 * ((y - hy) / sy) ** 2))
    return np.array(fx), np.array(fy)


def _plain(scene: Scene, y: np.ndarray) -> np.ndarray:
    """The plain rises gently to the north."""
    s = scene.settings
    return 27.0 + 22.0 * s.scale * (y - s.south) / (s.north - s.south)


def ground_at(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height of the bare ground at points (N,), m, pond included."""
    fx, fy = terrain_factors(scene, x, y)
    z = (fx * fy).sum(axis=0)
    return scene.pond.level + (z - scene.pond.level) * pond_blend(scene.pond, x, y)


def pond_blend(pond: Pond, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """0 on the water, 1 away from the shore, smooth between."""
    t = np.clip((pond_distance(pond, x, y) - 1.0) / 0.7, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def pond_distance(pond: Pond, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from the pond's centre in units of its half axes: 1 is the shore."""
    return np.hypot((x - pond.x) / pond.a, (y - pond.y) / pond.b)


def road_clearance(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from the edge of the nearest road or street at points (N,), m; negative on it."""
    clear = np.full(np.shape(x), np.inf)
    for k, along_x in enumerate(scene.roads.along_x):
        along, across = (x, y) if along_x else (y, x)
        centre, slope = scene.roads.centre_line(k, along)
        clear = np.minimum(clear, np.abs(across - centre) / np.hypot(1.0, slope) - scene.roads.half_width[k])
    u, v = scene.town.local(x, y)
    off_u = np.abs(u - STREET_SPACING[0] * np.rint(u / STREET_SPACING[0]))
    off_v = np.abs(v - STREET_SPACING[1] * np.rint(v / STREET_SPACING[1]))
    street = np.minimum(off_u, off_v) - scene.town.street_half_width
    return np.where(np.hypot(u, v) < scene.town.radius, np.minimum(clear, street), clear)


def building_clearance(buildings: Buildings, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from the nearest wall at points (N,), m; 0 or less inside a building."""
    clear = np.full(len(x), np.inf)
    for bx, by, cos, sin, length, width, _, _ in buildings.table:
        p = np.abs((x - bx) * cos + (y - by) * sin) - length
        q = np.abs((y - by) * cos - (x - bx) * sin) - width
        outside = np.hypot(np.maximum(p, 0.0), np.maximum(q, 0.0))
        clear = np.minimum(clear, np.where(np.maximum(p, q) < 0.0, np.maximum(p, q), outside))
    return clear


@lru_cache(maxsize=4)
def scene_of(settings: SceneSettings) -> Scene:
    """The scene that belongs to the settings. Raises GeometryError when the buildings find no room."""
    generator = np.random.default_rng(settings.seed)
    scene = _bare(settings, generator)
    scene = replace(scene, buildings=_houses(scene, generator))
    trees, feet = _grow_trees(scene, generator)
    return replace(scene, trees=trees, tree_feet=feet)


def height_bounds(scene: Scene, bounds: tuple[float, float, float, float]) -> tuple[float, float]:
    """Heights (m) between which everything inside (west, south, east, north) lies, objects included, with a margin of 1.5 m."""
    west, south, east, north = bounds
    x, y = np.meshgrid(np.linspace(west, east, max(2, int((east - west) / 12.0))),
                       np.linspace(south, north, max(2, int((north - south) / 12.0))))
    z = ground_at(scene, x.ravel(), y.ravel())
    # Between two samples 12 m apart the ground of slope 0.65 or less rises by 4 m at most.
    return float(z.min()) - 4.0, float(z.max()) + 4.0 + scene.settings.roof_top + 1.5


def scene_bounds(settings: SceneSettings) -> tuple[float, float, float, float]:
    """(west, south, east, north), m."""
    return settings.west, settings.south, settings.east, settings.north


def _bare(settings: SceneSettings, generator: np.random.Generator) -> Scene:
    """Relief, pond, town and roads; no building and no tree yet."""
    scene = Scene(
        settings=settings, waves=_waves(settings, generator), hills=_hills(settings),
        pond=Pond(0.0, 0.0, 1.0, 1.0, 0.0), town=_town(settings), roads=_roads(settings, generator),
        buildings=Buildings(*np.zeros((8, 0))), trees=np.zeros((0, 4)), tree_feet=np.zeros(0),
    )
    x, y = settings.place(0.64, 0.27)
    fx, fy = terrain_factors(scene, np.array([x]), np.array([y]))
    grown = max(settings.scale, 0.4)
    return replace(scene, pond=Pond(x, y, 70.0 * grown, 48.0 * grown, float((fx * fy).sum()) - 0.8))


def _waves(settings: SceneSettings, generator: np.random.Generator) -> np.ndarray:
    """Long gentle waves that grow with the scene, and short ones of half a metre."""
    length = np.concatenate([np.array([1150.0, 760.0, 520.0, 390.0]) * settings.scale, [140.0, 95.0, 70.0]])
    amplitude = np.concatenate([np.array([7.0, 4.0, 2.5, 1.6]) * settings.scale, [0.6, 0.4, 0.25]])
    direction = generator.uniform(0.0, np.pi, len(length))
    k = 2.0 * np.pi / length
    return np.column_stack([amplitude, k * np.cos(direction), k * np.sin(direction), generator.uniform(0.0, 2.0 * np.pi, len(length))])


def _hills(settings: SceneSettings) -> np.ndarray:
    """One steep hill (slope up to 0.6) and its low shoulder."""
    s = settings.scale
    return np.array([
        [*settings.place(0.735, 0.70), 88.0 * s, 98.0 * s, 92.0 * s],
        [*settings.place(0.80, 0.62), 16.0 * s, 130.0 * s, 150.0 * s],
    ])


def _town(settings: SceneSettings) -> Town:
    """Large enough for three quarters of the buildings."""
    x, y = settings.place(0.40, 0.50)
    return Town(x, y, float(np.sqrt(0.75 * settings.buildings * 1750.0 / np.pi)) + 12.0, np.radians(13.0), 3.4)


def _roads(settings: SceneSettings, generator: np.random.Generator) -> Roads:
    """Two roads from west to east and one from south to north."""
    places = [settings.place(0.5, 0.44)[1], settings.place(0.5, 0.83)[1], settings.place(0.56, 0.5)[0]]
    size = np.array([60.0, 90.0, 75.0]) * settings.scale
    length = np.array([1500.0, 2100.0, 1800.0]) * settings.scale
    return Roads(np.array([True, True, False]), np.array(places), size, 2.0 * np.pi / length,
                 generator.uniform(0.0, 2.0 * np.pi, 3), np.array([4.5, 3.5, 4.0]))


def _houses(scene: Scene, generator: np.random.Generator) -> Buildings:
    """Town houses on lots from the centre outwards, then farms and halls scattered over the country."""
    wanted = scene.settings.buildings
    town = _on_lots(scene, generator, round(0.75 * wanted))
    houses = _scattered(scene, generator, town, wanted - len(town))
    if len(houses) < wanted:
        raise GeometryError(f"the simulated scene has room for {len(houses)} buildings only, {wanted} were asked for: "
                            "ask for fewer buildings or enlarge the block")
    return houses


def _on_lots(scene: Scene, generator: np.random.Generator, wanted: int) -> Buildings:
    """Four lots in every block between the streets; the nearest to the centre that are free and level."""
    reach = int(scene.town.radius / min(STREET_SPACING)) + 1
    i, j, a, b = (part.ravel() for part in np.meshgrid(np.arange(-reach, reach), np.arange(-reach, reach), (0.27, 0.73), (0.27, 0.73)))
    u, v = (i + a) * STREET_SPACING[0], (j + b) * STREET_SPACING[1]
    order = np.argsort(np.hypot(u, v), kind="stable")
    u, v = u[order], v[order]
    keep = (np.hypot(u, v) < scene.town.radius - 18.0) & (generator.uniform(size=len(u)) < 0.93)
    x, y = scene.town.world(u[keep], v[keep])
    angle = np.full(len(x), scene.town.angle) + np.radians(generator.normal(0.0, 0.7, len(x)))
    length = generator.uniform(7.0, 12.5, len(x))
    width = generator.uniform(4.8, 9.0, len(x))
    return _build(scene, generator, (x, y, angle + np.pi / 2.0, length, width), wanted)


def _scattered(scene: Scene, generator: np.random.Generator, town: Buildings, wanted: int) -> Buildings:
    """Farms and halls anywhere, at any angle, one after the other where there is room."""
    count = 60 * max(wanted, 1)
    s = scene.settings
    x, y = generator.uniform(s.west + 15.0, s.east - 15.0, count), generator.uniform(s.south + 15.0, s.north - 15.0, count)
    angle = generator.uniform(0.0, np.pi, count)
    length, width = generator.uniform(8.0, 19.0, count), generator.uniform(5.0, 11.0, count)
    free = np.hypot(x - scene.town.x, y - scene.town.y) > scene.town.radius + 25.0
    chosen: list[int] = []
    spread = np.clip(90.0 * s.scale, 34.0, 60.0)
    for k in np.flatnonzero(free):
        if all(np.hypot(x[k] - x[m], y[k] - y[m]) > spread for m in chosen[-400:]):
            chosen.append(k)
    pick = np.array(chosen, dtype=int)
    country = _build(scene, generator, (x[pick], y[pick], angle[pick], length[pick], width[pick]), wanted)
    return Buildings(*(np.concatenate([a, b]) for a, b in zip(town.table.T, country.table.T, strict=True)))


def _build(scene: Scene, generator: np.random.Generator, plan: tuple[np.ndarray, ...], wanted: int) -> Buildings:
    """The first `wanted` floor plans (x, y, angle, half length, half width) that stand clear of roads and water on level ground."""
    x, y, angle, length, width = plan
    top = 4.0 + (scene.settings.roof_top - 4.0) * generator.uniform(size=len(x)) ** 2.2
    gabled = (top < 11.5) & (generator.uniform(size=len(x)) < 0.62)
    rise = np.where(gabled, width * np.tan(np.radians(generator.uniform(20.0, 36.0, len(x)))), 0.0)
    ground = _corner_ground(scene, plan)
    diagonal = np.hypot(length, width)
    away = (pond_distance(scene.pond, x, y) - 1.0) * min(scene.pond.a, scene.pond.b) > diagonal + 6.0
    level = np.ptp(ground, axis=0) < 2.4
    sides = _corners(plan, LOT_MARGIN)
    clear = np.min([road_clearance(scene, cx, cy) for cx, cy in sides], axis=0) > 0.0
    pick = np.flatnonzero(away & level & clear & (road_clearance(scene, x, y) > width))[:wanted]
    eaves = ground.max(axis=0) + np.maximum(top - rise, 3.0)
    return Buildings(*(part[pick] for part in (x, y, np.cos(angle), np.sin(angle), length, width, eaves, rise)))


def _corners(plan: tuple[np.ndarray, ...], margin: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corners and middles of the sides of floor plans, `margin` m outside."""
    x, y, angle, length, width = plan
    points = [(p, q) for p in (-1, 0, 1) for q in (-1, 0, 1) if (p, q) != (0, 0)]
    return [(x + p * (length + margin) * np.cos(angle) - q * (width + margin) * np.sin(angle),
             y + p * (length + margin) * np.sin(angle) + q * (width + margin) * np.cos(angle)) for p, q in points]


def _corner_ground(scene: Scene, plan: tuple[np.ndarray, ...]) -> np.ndarray:
    """(8, N): the ground around floor plans, m."""
    return np.array([ground_at(scene, cx, cy) for cx, cy in _corners(plan, 0.0)])


def _grow_trees(scene: Scene, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Woods, avenues, gardens and single trees that touch neither wall nor road nor water: (T, 4) and the ground under them (T,)."""
    x, y = np.concatenate([_woods(scene, generator), _avenues(scene, generator), _singles(scene, generator)], axis=1)
    height = generator.uniform(4.0, TREE_TOP - 0.8, len(x))
    radius = height * generator.uniform(0.28, 0.42, len(x)) + 0.3
    free = (road_clearance(scene, x, y) > 0.6 * radius) & (building_clearance(scene.buildings, x, y) > radius + 0.7)
    free &= (pond_distance(scene.pond, x, y) - 1.0) * min(scene.pond.a, scene.pond.b) > radius + 1.0
    x, y, height, radius = x[free], y[free], height[free], radius[free]
    feet = ground_at(scene, x, y)
    return np.column_stack([x, y, radius, feet + height]), feet


def _woods(scene: Scene, generator: np.random.Generator) -> np.ndarray:
    """(2, N) dense groves, one of them on the flank of the hill."""
    s = scene.settings
    centres = np.array([s.place(*place) for place in ((0.67, 0.66), (0.16, 0.80), (0.22, 0.18), (0.86, 0.30), (0.47, 0.88))])
    size = np.clip(62.0 * s.scale, 22.0, None)
    count = max(int(0.016 * np.pi * size**2), 20)
    grove = generator.integers(0, len(centres), count * len(centres))
    return (centres[grove] + generator.normal(0.0, 0.6 * size, (len(grove), 2)) * np.array([1.25, 0.8])).T


def _avenues(scene: Scene, generator: np.random.Generator) -> np.ndarray:
    """(2, N) trees along the country roads, with gaps."""
    s, rows = scene.settings, []
    for k, along_x in enumerate(scene.roads.along_x):
        along = np.arange(s.west, s.east, 17.0) if along_x else np.arange(s.south, s.north, 17.0)
        along = along[generator.uniform(size=len(along)) < 0.45]
        centre, _ = scene.roads.centre_line(k, along)
        across = centre + np.where(generator.uniform(size=len(along)) < 0.5, -1.0, 1.0) * (scene.roads.half_width[k] + 5.5)
        rows.append(np.array([along, across]) if along_x else np.array([across, along]))
    return np.concatenate(rows, axis=1)


def _singles(scene: Scene, generator: np.random.Generator) -> np.ndarray:
    """(2, N) trees of the gardens in town, and single ones in the country."""
    s = scene.settings
    radius = scene.town.radius * np.sqrt(generator.uniform(size=int(scene.town.radius**2 * np.pi / 420.0)))
    angle = generator.uniform(0.0, 2.0 * np.pi, len(radius))
    gardens = np.array([scene.town.x + radius * np.cos(angle), scene.town.y + radius * np.sin(angle)])
    count = int((s.east - s.west) * (s.north - s.south) / 7000.0)
    country = np.array([generator.uniform(s.west, s.east, count), generator.uniform(s.south, s.north, count)])
    return np.concatenate([gardens, country], axis=1)
