"""A mesh as it comes from a file, made fit for use: unit and place, no triangles without a plane, none twice, an origin of its own.

What is mended is counted. Holes are left: nothing is invented. A point cloud is triangulated in the plane that fits it best
(Delaunay), so it must be a surface with one height above that plane, as of one scan of a facade; triangles with edges many times
longer than usual span gaps and are left out.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.solid.census import MeshCensus, MeshTriangles, MeshVertices
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.geometry.reference_system import in_system
from orthomill.tasks.projection.frames.best_plane import best_plane
from orthomill.tasks.visibility.height_triangles import height_triangles
from orthomill.tasks.visibility.triangle_blocks import spatial_order

METRES = {"auto": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
"""metres of a unit of the file"""
LONGEST_EDGE = 8.0
"""median edges of a triangulated point cloud up to which a triangle is surface and no gap"""
_TOGETHER, _ENOUGH = 2**18, 1_000_000
"""triangles that are looked at at a time; those that tell the usual length of an edge"""
_FLAT = 1e-12  # height over longest edge, squared: rounding alone gives a triangle as much
_COARSE = 0.05
"""share of the median edge from which the rounding of stored coordinates deforms the surface"""


class MendedMesh(NamedTuple):
    """The mesh in its stored order, and what was found."""

    vertices: MeshVertices
    triangles: MeshTriangles
    census: MeshCensus


def mend_heights(heights: np.ndarray, grid: MapGrid, every: int) -> MendedMesh:
    """A height model (rows, cols) m on `grid` as a mesh, with every `every`-th of its rows and columns. Raises GeometryError."""
    # The middle of every group of cells, so that the mesh is not shifted.
    first = every // 2
    west, north = grid.west + (first + 0.5 - 0.5 * every) * grid.cell, grid.north - (first + 0.5 - 0.5 * every) * grid.cell
    part = heights[first::every, first::every]
    thin = MapGrid(west=west, north=north, cell=grid.cell * every, rows=part.shape[0], cols=part.shape[1])
    mesh = height_triangles(part, thin)
    if not len(mesh.triangles):
        raise GeometryError("The surface model has no three heights beside each other; nothing can be projected.")
    # No file has rounded it, although cells of whole or half metres look as if one had.
    return _mended(mesh, mesh.vertices + mesh.origin, from_file=False)


def mend_mesh(
    mesh: TriangleMesh, unit: str, shift: tuple[float, float, float], y_up: bool = False, systems: tuple[str, str] = ("", "")
) -> MendedMesh:
    """The usable part of a mesh in metres of the project's system: `shift` (m) is added to its coordinates after the unit.

    `y_up`: the file has Y upwards and Z to the south; `systems`: reference systems of the file ("": that of the project) and of the
    project. Raises GeometryError when nothing is left, or when its coordinates were rounded more coarsely than its shape.
    """
    stored = mesh.vertices + mesh.origin
    stored = np.column_stack([stored[:, 0], -stored[:, 2], stored[:, 1]]) if y_up else stored
    points = (stored * METRES[unit] if not systems[0] else in_system(stored, METRES[unit], *systems)) + shift
    return _mended(mesh, points, systems[0], from_file=True)


def _mended(mesh: TriangleMesh, points: np.ndarray, system: str = "", *, from_file: bool) -> MendedMesh:
    """The usable part of a mesh whose vertices lie at `points` (V, 3), m in the project's system; a file may have rounded them."""
    finite = np.asarray(np.isfinite(points).all(axis=1))
    if not finite.any():
        raise GeometryError("The mesh has no vertex with finite coordinates; export it again.")
    low, high = points[finite].min(axis=0), points[finite].max(axis=0)
    # A round place, so that a user can find it again; near the middle, where float32 is finest.
    origin = np.round(0.5 * (low + high))
    points = points - origin
    cloud = not len(mesh.triangles)
    triangles = triangulated(points, finite) if cloud else mesh.triangles
    known = np.asarray(finite[triangles].all(axis=1))
    flat = known & ~in_parts(points, triangles, has_a_plane)
    left = triangles[known & ~flat]
    twice = repeated(points, left)
    kept = left[~twice]
    if not len(kept):
        raise GeometryError(
            f"None of the {len(triangles)} triangles of the mesh can be used: {int((~known).sum())} have coordinates that are not "
            f"finite, {int(flat.sum())} have no area; export it again."
        )
    edge = _median_edge(points, kept)
    if from_file:
        _refuse_rounded(mesh.vertices, _median_edge(mesh.vertices, kept))
    kept = kept[spatial_order(in_parts(points, kept, _middles))]
    needed = np.zeros(len(points), bool)
    needed[kept.ravel()] = True
    used = np.flatnonzero(needed)
    points, kept = points[used], (np.cumsum(needed, dtype=np.int32) - 1)[kept]
    bodies, borders, turned = _topology(points, kept)
    colours = np.zeros((len(used), 3), np.uint8) if mesh.colours is None else mesh.colours[used]
    census = MeshCensus(
        vertices=len(points),
        triangles=len(kept),
        read=0 if cloud else len(mesh.triangles),
        not_finite=int((~known).sum()),
        degenerate=int(flat.sum()),
        duplicate=int(twice.sum()),
        triangulated=cloud,
        bodies=bodies,
        open_edges=borders,
        turned_edges=turned,
        system=system,
        median_edge=edge,
        origin=_three(origin),
        low=_three(points.min(axis=0) + origin),
        high=_three(points.max(axis=0) + origin),
    )
    return MendedMesh(MeshVertices(*points.T, *colours.T), MeshTriangles(*kept.T), census)


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def in_parts(points: np.ndarray, triangles: np.ndarray, of: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """What a function of points and triangles gives for all triangles, some at a time: corners in float64 take 72 bytes each."""
    parts = [of(points, triangles[k : k + _TOGETHER]) for k in range(0, len(triangles), _TOGETHER)]
    return np.concatenate(parts) if parts else of(points, triangles)


def _middles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    return np.asarray(points[triangles].mean(axis=1))


def has_a_plane(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """bool (T,): triangles whose three corners are not on a line."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return (normal**2).sum(axis=1) > _FLAT * longest**2


def _place_codes(points: np.ndarray) -> np.ndarray:
    """uint64 (V,): the same for vertices at the same place; STL repeats a vertex for each of its triangles."""
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)  # + 0: there are two zeros
    code = np.zeros(len(points), np.uint64)
    for column in bits.T:
        code = (code ^ column) * np.uint64(0x9E3779B97F4A7C15)
        code ^= code >> np.uint64(29)
    return code


def repeated(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """bool (T,): triangles between the same three places as an earlier one, whichever way they face."""
    codes = _place_codes(points)[triangles]
    codes.sort(axis=1)
    code = np.zeros(len(codes), np.uint64)
    for column in codes.T:
        code = (code ^ column) * np.uint64(0xBF58476D1CE4E5B9)
        code ^= code >> np.uint64(31)
    _, first = np.unique(code, return_index=True)
    out = np.ones(len(triangles), bool)
    out[first] = False
    return out


def _median_edge(points: np.ndarray, triangles: np.ndarray) -> float:
    some = triangles[:: -(-len(triangles) // _ENOUGH)]
    return float(np.median(np.linalg.norm(points[some[:, 0]] - points[some[:, 1]], axis=1)))


def _refuse_rounded(vertices: np.ndarray, edge: float) -> None:
    """Raises GeometryError where the stored coordinates are all float32 whose steps deform triangles with sides of `edge`."""
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    step = float(np.spacing(np.float32(np.abs(finite).max(initial=0.0))))
    # Coordinates that need float64 show it in nearly every vertex; a thousand settle it.
    some = finite[:: max(len(finite) // 1000, 1)]
    if step > _COARSE * edge and np.array_equal(some, some.astype(np.float32)):
        raise GeometryError(
            f"The coordinates of the mesh are rounded to {step:.2g} units (32 bit numbers of 7 digits, up to "
            f"{np.abs(finite).max():.0f}), but its triangles have sides of {edge:.2g}: the surface is deformed. Export it with an "
            "origin near the object and give that as `shift`, or with 64 bit coordinates."
        )


def _topology(points: np.ndarray, triangles: np.ndarray) -> tuple[int, int, int]:
    """Number of separate bodies, of edges with one triangle, and of edges between two that face opposite ways."""
    _, merged = np.unique(_place_codes(points), return_inverse=True)
    corners = merged.astype(np.int32)[triangles]
    count = int(corners.max()) + 1
    # Two edges of each triangle join its corners.
    ends = np.concatenate([corners[:, 0], corners[:, 1]]), np.concatenate([corners[:, 1], corners[:, 2]])
    graph = coo_matrix((np.ones(len(ends[0]), np.int8), ends), shape=(count, count))
    bodies, _ = connected_components(graph, directed=False)
    # The ends of an edge and the way in which it is run along, as one number: the whole list is sorted in place.
    code = np.empty((3, len(corners)), np.int64)
    for k in range(3):
        here, there = corners[:, k].astype(np.int64), corners[:, (k + 1) % 3]
        code[k] = 2 * (np.minimum(here, there) * count + np.maximum(here, there)) + (here < there)
    flat = code.ravel()
    flat.sort()
    upwards = (flat & 1).astype(np.int8)
    flat >>= 1
    first = np.flatnonzero(np.concatenate([[True], flat[1:] != flat[:-1]]))
    times = np.diff(first, append=len(flat))
    # Two triangles that face the same way run along their edge in opposite directions.
    ways = np.add.reduceat(upwards, first)
    return int(bodies), int((times == 1).sum()), int(((times == 2) & (ways != 1)).sum())


def triangulated(points: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """Triangles (T, 3) int32 of a point cloud (V, 3), counter-clockwise seen from above (or from the side that is nearer to it).

    Raises GeometryError for fewer than three points, or points on a line.
    """
    chosen = np.flatnonzero(finite)
    if len(chosen) < 3:
        raise GeometryError(f"The surface has {len(chosen)} points and no triangles; three points are needed.")
    plane = best_plane(points[chosen])
    flat = (points[chosen] - plane.point) @ np.array([plane.right, plane.up]).T
    try:
        found = Delaunay(flat).simplices
    except QhullError:
        raise GeometryError("The points of the surface cannot be triangulated, they lie on a line; give a mesh.") from None
    a, b, c = (flat[found[:, k]] for k in range(3))
    turned = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    found[turned] = found[turned][:, ::-1]
    triangles = chosen[found].astype(np.int32)
    sides = np.stack([np.linalg.norm(points[triangles[:, k]] - points[triangles[:, k - 1]], axis=1) for k in range(3)])
    return triangles[sides.max(axis=0) <= LONGEST_EDGE * np.median(sides)]
