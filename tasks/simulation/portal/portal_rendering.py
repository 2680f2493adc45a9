"""Photographs and the true front orthoimage of the portal, by casting rays (portal_casting) at painted surfaces (portal_colours).

Four rays a pixel from the true camera, distortion included; sun with hard shadows and an even sky with ambient occlusion; then the
lens, the exposure and the noise of the other simulation. All of it depends on the pixel's own position: tiles fit bit for bit.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.distortion import undistort_point
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.portal.portal_block import portal_exposure, to_portal, to_system, turn
from orthomill.tasks.simulation.portal.portal_casting import (
    NO_TRIANGLE,
    Cells,
    Facets,
    Shade,
    cells_of,
    central_boxes,
    facets_of,
    is_lit,
    nearest,
    open_sky,
    shade_of,
)
from orthomill.tasks.simulation.portal.portal_colours import paint
from orthomill.tasks.simulation.portal.portal_mesh import PortalMesh, leaves, person, portal_mesh, with_objects
from orthomill.tasks.simulation.portal.portal_targets import TARGETS, on_target
from orthomill.tasks.simulation.rendering import HALO, PSF_SIGMA, Film, blur, expose

TRUE_CELL = 0.08
"""m: sides of the triangles of the true mesh"""
FRONT = -3.0
"""y of the plane before the whole portal from which the front orthoimage is seen, m"""
_SUN = np.array([-0.52, -0.62, 0.59]) / np.linalg.norm([-0.52, -0.62, 0.59])
_SUNLIGHT, _SKYLIGHT, _BOUNCED = 0.62, 0.5, 0.2
_SKY = (176.0, 196.0, 222.0)
_SUBPIXEL = 0.25  # px: the four rays of a pixel pass through the middles of its quarters
_CELL = 0.003  # of c: cells of the picture, some 8 px of the full photographs
_PEOPLE = {1: ((0.9, -2.35), (-1.15, -1.2)), 4: ((-0.35, -2.2),), 2: ((-2.0, -2.6),)}
"""photograph -> where people stand, counted from 0"""
_TWIGS = {0: (-0.62, 0.40), 3: (0.55, 0.42), 5: (0.42, -0.5)}
"""photograph -> where leaves hang into it, in units of c from its middle"""


@dataclass(frozen=True, eq=False)
class LitScene:
    """A mesh with its light: `sky` (V,) share of the sky, `shade` of the sun."""

    mesh: PortalMesh
    facets: Facets
    normals: np.ndarray
    sky: np.ndarray
    shade: Shade


@cache
def lit_scene() -> LitScene:
    """The portal without people and leaves."""
    return _lit(portal_mesh(TRUE_CELL))


def _lit(mesh: PortalMesh) -> LitScene:
    facets = facets_of(mesh.vertices, mesh.triangles)
    normals = facets.normals
    of_vertices = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(of_vertices, mesh.triangles[:, k], normals)
    of_vertices /= np.maximum(np.linalg.norm(of_vertices, axis=1, keepdims=True), 1e-12)
    sky = open_sky(mesh.vertices, mesh.triangles, of_vertices)
    return LitScene(mesh, facets, normals, sky, shade_of(mesh.vertices, mesh.triangles, _SUN, 0.03))


@cache
def scene_of_photograph(view: View, number: int, seed: int) -> LitScene:
    """The portal with the people and leaves that are there while photograph `number` (from 0) is taken. They cast no shadows."""
    rest = lit_scene()
    objects = [person(*place) for place in _PEOPLE.get(number, ())]
    if number in _TWIGS:
        a, b = _TWIGS[number]
        middle = view.centre + 1.6 * np.array([a, b, -1.0]) @ view.rotation
        objects.append(leaves(to_portal(middle), 0.17, 130, seed + number))
    if not objects:
        return rest
    mesh = with_objects(rest.mesh, objects)
    facets = facets_of(mesh.vertices, mesh.triangles)
    sky = np.concatenate([rest.sky, np.full(len(mesh.vertices) - len(rest.sky), 0.6)])
    return LitScene(mesh, facets, facets.normals, sky, rest.shade)


def photograph_portal(view: View, number: int, seed: int, noise_sigma: float, pixels: Window) -> np.ndarray:
    """The window `pixels` of a photograph, uint8 (rows, cols, 3)."""
    film = Film(portal_exposure(seed, number), noise_sigma, seed)
    light = _cast(scene_of_photograph(view, number, seed), view, pixels.grown(HALO), seed)
    return expose(blur(light, PSF_SIGMA), film, view, pixels)


def _cast(scene: LitScene, view: View, pixels: Window, seed: int) -> np.ndarray:
    """Light on the pixels of a window that may leave the photograph: float32 (rows, cols, 3)."""
    out = np.zeros((*pixels.shape, 3), np.float32)
    centre, axes = to_portal(view.centre), np.ascontiguousarray(view.rotation @ turn())
    cells = picture_cells(scene, view, pixels)
    _cast_central(out, view.numbers, (pixels.row, pixels.col), centre, axes, cells, _arrays(scene), seed)
    return out


def picture_cells(scene: LitScene, view: View, pixels: Window) -> Cells:
    """The triangles by the cells of what a window of a photograph shows, in the picture without distortion, in units of c."""
    n = view.numbers
    col = np.linspace(pixels.col - 1.0, pixels.col + pixels.width, 9)
    row = np.linspace(pixels.row - 1.0, pixels.row + pixels.height, 9)
    border = np.array([(c, r) for c in col for r in row])
    xy = np.array([undistort_point((c - n.col0) / n.c, (n.row0 - r) / n.c, n.lens) for c, r in border]) * [1.0, -1.0]
    margin = 3.0 / n.c
    (left, upper), (right, lower) = xy.min(axis=0) - margin, xy.max(axis=0) + margin
    points = (scene.mesh.vertices - to_portal(view.centre)) @ (view.rotation @ turn()).T
    low, high = central_boxes(points, scene.mesh.triangles)
    return cells_of(low, high, (left, upper, right, lower), _CELL)


def _arrays(scene: LitScene) -> tuple[np.ndarray | Shade, ...]:
    """What the kernels read of a scene."""
    mesh, facets = scene.mesh, scene.facets
    return (
        facets.corner,
        facets.along,
        facets.above,
        scene.normals,
        mesh.triangles,
        mesh.place,
        mesh.material,
        scene.sky,
        scene.shade,
        TARGETS,
    )


@njit()
def _light_of(arrays, hit, share, other, place, seed, out):
    """Adds the light that a place of triangle `hit` sends into every direction to `out` (3,)."""
    corner, along, above, normals, triangles, places, material, sky, shade, targets = arrays
    a, b, c = triangles[hit, 0], triangles[hit, 1], triangles[hit, 2]
    first = 1.0 - share - other
    s = first * places[a, 0] + share * places[b, 0] + other * places[c, 0]
    t = first * places[a, 1] + share * places[b, 1] + other * places[c, 1]
    colour = np.empty(3)
    paint(material[hit], s, t, seed, colour)
    on_target(targets, place, normals[hit], colour)
    facing = normals[hit, 0] * _SUN[0] + normals[hit, 1] * _SUN[1] + normals[hit, 2] * _SUN[2]
    light = _BOUNCED + _SKYLIGHT * (first * sky[a] + share * sky[b] + other * sky[c])
    if facing > 0.0:
        start = np.empty(3)
        for k in range(3):
            start[k] = place[k] + 0.004 * normals[hit, k]
        # Triangles of people and leaves are behind the numbers that the shade knows.
        if is_lit(shade, corner, along, above, start):
            light += _SUNLIGHT * facing
    for band in range(3):
        out[band] += np.float32(0.25) * np.float32(min(1.2 * light, 1.05) * colour[band])


@njit()
def _cast_central(out, n, corner_px, centre, axes, cells, arrays, seed):
    """Colours of a photograph, four rays a pixel, into `out` (r, c, 3). n: the camera; corner_px: row and column of its first
    pixel; axes (3, 3): rows of the rotation; cells, arrays: the triangles by cell of the view."""
    ray, place = np.empty(3), np.empty(3)
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            for part in range(4):
                x = corner_px[1] + col + (_SUBPIXEL if part % 2 else -_SUBPIXEL)
                y = corner_px[0] + row + (_SUBPIXEL if part // 2 else -_SUBPIXEL)
                a, b = undistort_point((x - n.col0) / n.c, (n.row0 - y) / n.c, n.lens)
                for k in range(3):
                    ray[k] = a * axes[0, k] + b * axes[1, k] - axes[2, k]
                hit, far, share, other = nearest(cells, arrays[0], arrays[1], arrays[2], a, -b, centre, ray)
                if hit == NO_TRIANGLE:
                    for band in range(3):
                        out[row, col, band] += np.float32(0.25 * _SKY[band])
                    continue
                for k in range(3):
                    place[k] = centre[k] + far * ray[k]
                _light_of(arrays, hit, share, other, place, seed, out[row, col])


def front_orthoimage(grid: MapGrid, window: Window, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Light, float32 (rows, cols, 3), and depth, float32 (rows, cols) m towards the viewer from the plane of the facade (NaN:
    nothing), of the true front orthoimage; the grid has x along the facade and y upwards."""
    scene = lit_scene()
    xy = scene.mesh.vertices[:, [0, 2]] * (1.0, -1.0)
    corners = xy[scene.mesh.triangles]
    left, upper = grid.west + window.col * grid.cell, -grid.north + window.row * grid.cell
    size = left + window.width * grid.cell, upper + window.height * grid.cell
    cells = cells_of(corners.min(axis=1), corners.max(axis=1), (left, upper, *size), 0.03)
    light, depth = np.zeros((*window.shape, 3), np.float32), np.full(window.shape, np.nan, np.float32)
    _cast_parallel(light, depth, (grid.west, grid.north, grid.cell), (window.row, window.col), cells, _arrays(scene), seed)
    return light, depth


@njit()
def _cast_parallel(out, depth, frame, corner_px, cells, arrays, seed):
    """Colours of the facade seen straight, into `out` (r, c, 3), and its `depth` (r, c) m. frame: west, north and cell, m."""
    west, north, cell = frame
    ray, origin, place = np.array([0.0, 1.0, 0.0]), np.empty(3), np.empty(3)
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            for part in range(5):
                # The fifth ray, through the middle, tells the depth and no colour.
                dx = 0.0 if part == 4 else (_SUBPIXEL if part % 2 else -_SUBPIXEL)
                dy = 0.0 if part == 4 else (_SUBPIXEL if part // 2 else -_SUBPIXEL)
                origin[0] = west + (corner_px[1] + col + 0.5 + dx) * cell
                origin[1] = FRONT
                origin[2] = north - (corner_px[0] + row + 0.5 + dy) * cell
                hit, far, share, other = nearest(cells, arrays[0], arrays[1], arrays[2], origin[0], -origin[2], origin, ray)
                if hit == NO_TRIANGLE:
                    continue
                if part == 4:
                    depth[row, col] = -(FRONT + far)
                    continue
                place[0], place[1], place[2] = origin[0], FRONT + far, origin[2]
                _light_of(arrays, hit, share, other, place, seed, out[row, col])


def seen_from(scene: LitScene, station: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N,) bool: whether nothing stands between a station (3,) before the portal and places (N, 3), m along its axes."""
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    low, high = central_boxes((scene.mesh.vertices - station) @ axes.T, scene.mesh.triangles)
    out = np.zeros(len(places), np.bool_)
    facets = (scene.facets.corner, scene.facets.along, scene.facets.above)
    _see(np.ascontiguousarray(places), station, axes, cells_of(low, high, (-3.0, -3.0, 3.0, 3.0), 0.01), facets, out)
    return out


def sees(scene: LitScene, view: View, places: np.ndarray) -> np.ndarray:
    """(N,) bool: whether a photograph sees places (N, 3) of the portal, m along its axes: inside it, and nothing nearer on the
    ray."""
    centre = to_portal(view.centre)
    axes = np.ascontiguousarray(view.rotation @ turn())
    inside = view.contains(view.project(to_system(places)), 2.0)
    cells = picture_cells(scene, view, Window(0, 0, view.camera.height, view.camera.width))
    facets = scene.facets
    out = np.zeros(len(places), np.bool_)
    _see(np.ascontiguousarray(places), centre, axes, cells, (facets.corner, facets.along, facets.above), out)
    return out & inside


@njit()
def _see(places, centre, axes, cells, facets, out):
    """Whether nothing lies between the `centre` and each of `places` (n, 3), into `out` (n,)."""
    ray = np.empty(3)
    for i in range(len(places)):
        for k in range(3):
            ray[k] = places[i, k] - centre[k]
        a, b, c = axes[0] @ ray, axes[1] @ ray, axes[2] @ ray
        if c >= 0.0:
            continue
        hit, far, _, _ = nearest(cells, facets[0], facets[1], facets[2], -a / c, b / c, centre, ray)
        out[i] = hit != NO_TRIANGLE and far > 0.9995
