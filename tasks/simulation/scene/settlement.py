"""Draws the layout of a simulated scene: everything in it, once, from a seed.

Places are fractions of the scene's bounds and the relief grows with the flying height, so that the same settings give a plausible
scene for a block of two square kilometres or of a few hectares. Houses are placed on lots along streets first, then scattered over
the country; trees fill the remaining space.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.simulation.scene.layout import (
    STREET_SPACING,
    Buildings,
    Pond,
    Roads,
    Scene,
    SceneSettings,
    Town,
    building_clearance,
    ground_at,
    pond_distance,
    road_clearance,
    terrain_factors,
)

TREE_TOP = 12.5
"""m: no tree is higher above its ground."""
LOT_MARGIN = 3.0
"""m around a floor plan that stay clear of roads"""
_IN_TOWN = 0.75  # share of the buildings; the rest gives occlusions outside the town
_LOT_AREA = 1750.0  # m^2 of the town per building, streets and empty lots included
_LEVEL = 2.4  # m: ground under a floor plan that varies by more would put its lower side on a wall of its own
_OFF_SHORE = 6.0  # m between a building and the shore
_WOOD_DRAWS = 6  # a stream of random numbers of its own
_WOOD_PLACE = 0.48, 0.54  # of a closed wood, as a share of the scene
_WOOD_SPREAD, _TRIED = 3.6, 25  # m between its trees, and places tried for each


@lru_cache(maxsize=4)
def scene_of(settings: SceneSettings) -> Scene:
    """The scene that belongs to the settings. Raises GeometryError when there is not enough room for the buildings."""
    # One generator in a fixed order: whatever is drawn first moves everything drawn after it.
    generator = np.random.default_rng(settings.seed)
    scene = _bare(settings, generator)
    scene = replace(scene, buildings=_houses(scene, generator))
    trees, feet = _grow_trees(scene, generator)
    if settings.wood:
        trees, feet = _with_wood(scene, trees, feet)
    return replace(scene, trees=trees, tree_feet=feet)


def _bare(settings: SceneSettings, generator: np.random.Generator) -> Scene:
    """Relief, pond, town and roads; no building and no tree yet."""
    scene = Scene(
        settings=settings,
        waves=_waves(settings, generator),
        hills=_hills(settings),
        pond=Pond(0.0, 0.0, 1.0, 1.0, 0.0),
        town=_town(settings),
        roads=_roads(settings, generator),
        buildings=Buildings(*np.zeros((8, 0))),
        trees=np.zeros((0, 4)),
        tree_feet=np.zeros(0),
    )
    # The pond needs the height of the relief at its place, so it is added to a scene that has none.
    x, y = settings.place(0.64, 0.27)
    fx, fy = terrain_factors(scene, np.array([x]), np.array([y]))
    grown = max(settings.scale, 0.4)
    return replace(scene, pond=Pond(x, y, 70.0 * grown, 48.0 * grown, float((fx * fy).sum()) - 0.8))


def _waves(settings: SceneSettings, generator: np.random.Generator) -> np.ndarray:
    """Long gentle waves that grow with the scene, and short ones of half a metre."""
    # The short ones keep their size: matching windows of the small block see relief of the same kind.
    length = np.concatenate([np.array([1150.0, 760.0, 520.0, 390.0]) * settings.scale, [140.0, 95.0, 70.0]])
    amplitude = np.concatenate([np.array([7.0, 4.0, 2.5, 1.6]) * settings.scale, [0.6, 0.4, 0.25]])
    direction = generator.uniform(0.0, np.pi, len(length))
    k = 2.0 * np.pi / length
    phase = generator.uniform(0.0, 2.0 * np.pi, len(length))
    return np.column_stack([amplitude, k * np.cos(direction), k * np.sin(direction), phase])


def _hills(settings: SceneSettings) -> np.ndarray:
    """One steep hill (slope up to 0.6) and its low shoulder."""
    s = settings.scale
    return np.array(
        [
            [*settings.place(0.735, 0.70), 88.0 * s, 98.0 * s, 92.0 * s],
            [*settings.place(0.80, 0.62), 16.0 * s, 130.0 * s, 150.0 * s],
        ]
    )


def _town(settings: SceneSettings) -> Town:
    """Large enough for three quarters of the buildings."""
    x, y = settings.place(0.40, 0.50)
    # 13 degrees: streets along the grid would make edges that are matched equally well anywhere along a row.
    return Town(x, y, float(np.sqrt(_IN_TOWN * settings.buildings * _LOT_AREA / np.pi)) + 12.0, np.radians(13.0), 3.4)


def _roads(settings: SceneSettings, generator: np.random.Generator) -> Roads:
    """Two roads from west to east and one from south to north."""
    places = [settings.place(0.5, 0.44)[1], settings.place(0.5, 0.83)[1], settings.place(0.56, 0.5)[0]]
    size = np.array([60.0, 90.0, 75.0]) * settings.scale
    length = np.array([1500.0, 2100.0, 1800.0]) * settings.scale
    return Roads(
        np.array([True, True, False]),
        np.array(places),
        size,
        2.0 * np.pi / length,
        generator.uniform(0.0, 2.0 * np.pi, 3),
        np.array([4.5, 3.5, 4.0]),
    )


def _houses(scene: Scene, generator: np.random.Generator) -> Buildings:
    """Town houses on lots from the centre outwards, then farms and halls scattered over the country."""
    wanted = scene.settings.buildings
    town = _on_lots(scene, generator, round(_IN_TOWN * wanted))
    houses = _scattered(scene, generator, town, wanted - len(town))
    if len(houses) < wanted:
        raise GeometryError(
            f"The simulated scene has room for {len(houses)} buildings only, but {wanted} were requested; request fewer buildings "
            "or enlarge the block."
        )
    return houses


def _on_lots(scene: Scene, generator: np.random.Generator, wanted: int) -> Buildings:
    """Four lots in every block between the streets; the nearest to the centre that are free and level."""
    reach = int(scene.town.radius / min(STREET_SPACING)) + 1
    blocks = np.arange(-reach, reach)
    i, j, a, b = (part.ravel() for part in np.meshgrid(blocks, blocks, (0.27, 0.73), (0.27, 0.73)))
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
    count = 60 * max(wanted, 1)  # candidates: most fall into the town, onto slopes or too near to others
    s = scene.settings
    x, y = generator.uniform(s.west + 15.0, s.east - 15.0, count), generator.uniform(s.south + 15.0, s.north - 15.0, count)
    angle = generator.uniform(0.0, np.pi, count)
    length, width = generator.uniform(8.0, 19.0, count), generator.uniform(5.0, 11.0, count)
    free = np.hypot(x - scene.town.x, y - scene.town.y) > scene.town.radius + 25.0
    spread = float(np.clip(90.0 * s.scale, 34.0, 60.0))
    pick = _apart(np.column_stack([x, y]), np.flatnonzero(free), spread, 4 * wanted)
    country = _build(scene, generator, (x[pick], y[pick], angle[pick], length[pick], width[pick]), wanted)
    return Buildings(*(np.concatenate([a, b]) for a, b in zip(town.table.T, country.table.T, strict=True)))


def _apart(points: np.ndarray, candidates: np.ndarray, spread: float, enough: int) -> np.ndarray:
    """The first `enough` candidates that keep `spread` m from all chosen before them."""
    chosen: list[int] = []
    for k in candidates:
        if len(chosen) == enough:
            break
        if not chosen or np.hypot(*(points[chosen] - points[k]).T).min() > spread:
            chosen.append(int(k))
    return np.array(chosen, dtype=int)


def _build(scene: Scene, generator: np.random.Generator, plan: tuple[np.ndarray, ...], wanted: int) -> Buildings:
    """The first `wanted` floor plans (x, y, angle, half length, half width) on level ground, clear of roads and water."""
    x, y, angle, length, width = plan
    # The power makes most buildings low and a few as high as allowed, as in a town.
    top = 4.0 + (scene.settings.roof_top - 4.0) * generator.uniform(size=len(x)) ** 2.2
    gabled = (top < 11.5) & (generator.uniform(size=len(x)) < 0.62)
    rise = np.where(gabled, width * np.tan(np.radians(generator.uniform(20.0, 36.0, len(x)))), 0.0)
    ground = _corner_ground(scene, plan)
    diagonal = np.hypot(length, width)
    away = (pond_distance(scene.pond, x, y) - 1.0) * min(scene.pond.a, scene.pond.b) > diagonal + _OFF_SHORE
    level = np.ptp(ground, axis=0) < _LEVEL
    sides = _corners(plan, LOT_MARGIN)
    clear = np.min([road_clearance(scene, cx, cy) for cx, cy in sides], axis=0) > 0.0
    pick = np.flatnonzero(away & level & clear & (road_clearance(scene, x, y) > width))[:wanted]
    eaves = ground.max(axis=0) + np.maximum(top - rise, 3.0)  # three metres of wall at least, on the uphill side
    return Buildings(*(part[pick] for part in (x, y, np.cos(angle), np.sin(angle), length, width, eaves, rise)))


def _corners(plan: tuple[np.ndarray, ...], margin: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corners and middles of the sides of floor plans, `margin` m outside."""
    x, y, angle, length, width = plan
    points = [(p, q) for p in (-1, 0, 1) for q in (-1, 0, 1) if (p, q) != (0, 0)]
    return [
        (
            x + p * (length + margin) * np.cos(angle) - q * (width + margin) * np.sin(angle),
            y + p * (length + margin) * np.sin(angle) + q * (width + margin) * np.cos(angle),
        )
        for p, q in points
    ]


def _corner_ground(scene: Scene, plan: tuple[np.ndarray, ...]) -> np.ndarray:
    """(8, N): the ground around floor plans, m."""
    return np.array([ground_at(scene, cx, cy) for cx, cy in _corners(plan, 0.0)])


def _grow_trees(scene: Scene, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Groves, avenues and single trees: (T, 4) and the ground under them (T,)."""
    x, y = np.concatenate([_woods(scene, generator), _avenues(scene, generator), _singles(scene, generator)], axis=1)
    height = generator.uniform(4.0, TREE_TOP - 0.8, len(x))
    radius = height * generator.uniform(0.28, 0.42, len(x)) + 0.3
    return _free_trees(scene, x, y, height, radius)


def _free_trees(
    scene: Scene, x: np.ndarray, y: np.ndarray, height: np.ndarray, radius: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Those of the trees that touch neither wall nor water nor extend far over a road: (T, 4) and the ground under them (T,)."""
    free = (road_clearance(scene, x, y) > 0.6 * radius) & (building_clearance(scene.buildings, x, y) > radius + 0.7)
    free &= (pond_distance(scene.pond, x, y) - 1.0) * min(scene.pond.a, scene.pond.b) > radius + 1.0
    x, y, height, radius = x[free], y[free], height[free], radius[free]
    feet = ground_at(scene, x, y)
    return np.column_stack([x, y, radius, feet + height]), feet


def wood_centre(settings: SceneSettings) -> tuple[float, float]:
    """The middle of the closed wood, m."""
    return settings.place(*_WOOD_PLACE)


def _with_wood(scene: Scene, trees: np.ndarray, feet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The trees with a closed wood, in which crowns touch: those that stood there before are gone."""
    # A generator of its own: a wood changes nothing of what else is in the scene.
    generator = np.random.default_rng([scene.settings.seed, _WOOD_DRAWS])
    centre, size = np.array(wood_centre(scene.settings)), scene.settings.wood
    away = size * np.sqrt(generator.uniform(size=int(_TRIED * (size / _WOOD_SPREAD) ** 2)))
    turned = generator.uniform(0.0, 2.0 * np.pi, len(away))
    points = centre + np.column_stack([away * np.cos(turned), away * np.sin(turned)])
    x, y = points[_apart(points, np.arange(len(points)), _WOOD_SPREAD, len(points))].T
    height = generator.uniform(0.62, 1.0, len(x)) * (TREE_TOP - 0.8)
    radius = _WOOD_SPREAD * generator.uniform(0.9, 1.15, len(x))
    wood, ground = _free_trees(scene, x, y, height, radius)
    kept = np.hypot(*(trees[:, :2] - centre).T) > size + _WOOD_SPREAD
    return np.concatenate([trees[kept], wood]), np.concatenate([feet[kept], ground])


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
