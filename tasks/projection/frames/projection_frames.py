"""The frames of all outputs: where they lie, how large they are and how fine, as the workflow says or as the surface and the
photographs suggest.

What the photographs show decides: a mesh often reaches farther (a skirt into the sky, the ground behind), and nobody wants a
picture of that. Every mistake that would give an empty picture is told here, with the distance or the factor by which it misses.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import BrownLens, Camera
from orthomill.schemas.errors import GeometryError, some_of
from orthomill.schemas.orientation import Block
from orthomill.schemas.solid.census import MeshCensus, MeshTriangles, MeshVertices
from orthomill.schemas.solid.frames import AnyFrame, CylinderFrame, FlatFrame, OutputFrames, Vector, ViewFrame
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.projection.frames.best_plane import PlaneAxes, best_plane, plane_axes
from orthomill.tasks.projection.frames.misplaced_surface import fitting_unit, refuse_tiny, shown_by, why_unseen
from orthomill.tasks.projection.outputs import (
    AnyOutput,
    CylinderOutput,
    MapOutput,
    PerspectiveOutput,
    PhotographOutput,
    PlaneOutput,
)

MOST_PIXELS = 2_000_000_000
"""Pixels of one output beyond which its unit or its pixel is taken for a mistake"""
PROBES = 200_000
"""triangles that stand for a mesh of more"""
LEAST_PROBES = 20_000
"""points that stand for the surface of a mesh of fewer triangles"""
_TRIM = 0.3
"""per cent of the seen surface on either side that an extent leaves out: single triangles far from the object"""
_EDGE_ON = 0.02
"""mean cosine between the surface and the plane of an output below which nothing of it could be seen there"""
_STEEPEST = float(np.cos(np.radians(80.0)))
"""cosine between an oblique projection and the normal of its plane below which nothing could be read from it"""
_UP = np.array([0.0, 0.0, 1.0])
_LEVEL, _OVERHEAD = 0.7, 0.3
"""Z of the normal from which a plane is a floor and no wall; minus the mean cosine from which photographs are upside down"""


@dataclass(frozen=True, eq=False)
class SeenSurface:
    """Middles (N, 3) m and normals (N, 3), of the length of twice the area, of triangles that stand for what photographs show."""

    points: np.ndarray
    normals: np.ndarray
    views: tuple[View, ...]
    pixel: float
    """median side of a pixel of the photographs on it, m"""

    @property
    def camera_side(self) -> np.ndarray:
        """Mean projection centre (3,)."""
        return np.mean([view.centre for view in self.views], axis=0)


def output_frames(
    vertices: MeshVertices,
    triangles: MeshTriangles,
    census: MeshCensus,
    block: Block,
    outputs: tuple[AnyOutput, ...],
    taking_part: tuple[str, ...],
    unit: str = "auto",
) -> OutputFrames:
    """The frames of `outputs`; `taking_part`: names of the photographs. Raises GeometryError for what would be empty."""
    seen = seen_surface(vertices, triangles, census, tuple(block_view(block, name) for name in taking_part), unit)
    return OutputFrames(frames=tuple(checked(frame_of(output, seen, block)) for output in outputs), pixel=seen.pixel)


def seen_surface(
    vertices: MeshVertices, triangles: MeshTriangles, census: MeshCensus, views: tuple[View, ...], unit: str = "auto"
) -> SeenSurface:
    """What of a mesh lies in the frames of photographs; hidden or not; `unit` "auto": metres, examined.

    Raises GeometryError when nothing does.
    """
    if not views:
        raise GeometryError("No photograph is oriented or all are left out; the surface cannot be coloured.")
    step = -(-census.triangles // PROBES)
    points = np.column_stack([vertices.x, vertices.y, vertices.z]) + census.origin
    corners = points[np.column_stack([triangles.a, triangles.b, triangles.c])[::step]]
    middles = spread_over(corners, max(int(np.ceil(np.sqrt(LEAST_PROBES / len(corners)))), 1))
    normals = np.repeat(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), len(middles) // len(corners), axis=0
    )
    shown, sizes = shown_by(views, middles)
    fitting = fitting_unit(views, middles, float(shown.mean()))
    # What a workflow states is believed as long as anything is in sight.
    if not shown.any() or (fitting and unit == "auto"):
        raise GeometryError(why_unseen(census, views, float(shown.mean()), fitting, unit))
    refuse_tiny(census, views, middles, sizes, unit)
    return SeenSurface(middles[shown], normals[shown], views, float(np.median(sizes)))


def spread_over(corners: np.ndarray, side: int) -> np.ndarray:
    """Points (T * n, 3) spread evenly over triangles (T, 3, 3): the middles of `side`^2 parts of each."""
    # A triangle may be larger than all photographs together: its own middle is then beside them.
    i, j = (values.ravel() for values in np.indices((side, side)))
    upright, turned = i + j < side, i + j < side - 1
    first = np.concatenate([(i[upright] + 1 / 3) / side, (i[turned] + 2 / 3) / side])
    second = np.concatenate([(j[upright] + 1 / 3) / side, (j[turned] + 2 / 3) / side])
    shares = np.stack([1.0 - first - second, first, second], axis=1)
    return np.einsum("nk,tki->tni", shares, corners).reshape(-1, 3)


def round_pixel(size: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `size` by more than a fifth."""
    power = float(10.0 ** np.floor(np.log10(size)))
    return max(step * power for step in (0.5, 1.0, 2.0, 5.0, 10.0) if step * power <= 1.2 * size)


def frame_of(output: AnyOutput, seen: SeenSurface, block: Block) -> AnyFrame:
    """The frame of one output. Raises GeometryError."""
    if isinstance(output, PerspectiveOutput):
        return _perspective(output)
    if isinstance(output, PhotographOutput):
        return photograph_frame(output.name, output.photo, block, output.distortion == "kept", output.itself)
    pixel = round_pixel(seen.pixel) if output.pixel == "auto" else output.pixel
    if isinstance(output, CylinderOutput):
        return _cylinder(output, pixel)
    frame = _map(output, seen, pixel) if isinstance(output, MapOutput) else _plane(output, seen, pixel)
    return frame if output.only is None else frame.model_copy(update={"without": _all_but(output.only, output.name, block)})


def _all_but(photo: str, output: str, block: Block) -> tuple[str, ...]:
    """The names of all other photographs. Raises GeometryError for one that the block does not have."""
    if photo not in block.names:
        raise GeometryError(f"The photograph '{photo}' of the output '{output}' is not oriented; there are {some_of(block.names)}.")
    return tuple(name for name in block.names if name != photo)


def checked(frame: AnyFrame) -> AnyFrame:
    """The frame. Raises GeometryError when it is too large to be meant."""
    if frame.rows * frame.cols > MOST_PIXELS:
        raise GeometryError(
            f"The output '{frame.name}' would have {frame.cols} x {frame.rows} pixels; give a larger `pixel`, a `size`, or the "
            "unit of the surface."
        )
    return frame


def _extent(values: np.ndarray) -> tuple[float, float]:
    low, high = np.percentile(values, [_TRIM, 100 - _TRIM])
    # What is left out is an outlier or the rim itself: a rim is near.
    reach = 0.05 * (high - low)
    near = values[(values >= low - reach) & (values <= high + reach)]
    return float(near.min()), float(near.max())


def _map(output: MapOutput, seen: SeenSurface, pixel: float) -> FlatFrame:
    (west, east), (south, north) = _extent(seen.points[:, 0]), _extent(seen.points[:, 1])
    # On multiples of the pixel, so that two maps of one place fit together.
    west, north = np.floor(west / pixel) * pixel, np.ceil(north / pixel) * pixel
    rows, cols = int(np.ceil((north - south) / pixel)), int(np.ceil((east - west) / pixel))
    level = float(np.median(seen.points[:, 2]))
    return FlatFrame(
        name=output.name,
        rows=max(rows, 1),
        cols=max(cols, 1),
        corner=(float(west), float(north), level),
        right=(1.0, 0.0, 0.0),
        up=(0.0, 1.0, 0.0),
        normal=(0.0, 0.0, 1.0),
        pixel=pixel,
        level=True,
    )


def vector(values: np.ndarray) -> Vector:
    """Three plain numbers."""
    x, y, z = map(float, values)
    return x, y, z


def chosen_plane(output: PlaneOutput, seen: SeenSurface) -> PlaneAxes:
    """The plane of an output. Raises GeometryError where its points do not determine it."""
    plane = output.plane
    if plane.kind == "normal":
        return plane_axes(np.array(plane.point), np.array(plane.normal))
    if plane.kind == "points":
        a, b, c = np.array(plane.points)
        normal = np.cross(b - a, c - a)
        if np.linalg.norm(normal) <= 1e-9 * np.linalg.norm(b - a) * np.linalg.norm(c - a):
            raise GeometryError(f"The three points of the plane of '{output.name}' lie on a line; give a third one beside it.")
        return plane_axes((a + b + c) / 3.0, normal)
    if plane.kind == "edge":
        left, right = np.array(plane.left), np.array(plane.right)
        normal = np.cross(right - left, _UP)
        if np.linalg.norm(normal) <= 1e-9 * max(float(np.linalg.norm(right - left)), 1e-300):
            raise GeometryError(
                f"The edge of the plane of '{output.name}' is upright or a point; give two points beside each other."
            )
        return plane_axes(0.5 * (left + right), normal)
    if plane.kind == "fit":
        low, high = np.array(plane.low or (-np.inf,) * 3), np.array(plane.high or (np.inf,) * 3)
        part = seen.points[((seen.points >= low) & (seen.points <= high)).all(axis=1)]
        if len(part) < 3:
            raise GeometryError(f"No surface lies between `low` and `high` of the plane of '{output.name}'; widen them.")
        return as_photographed(best_plane(part, seen.camera_side), seen.views)
    return as_photographed(facade_plane(seen), seen.views)


def as_photographed(axes: PlaneAxes, views: tuple[View, ...]) -> PlaneAxes:
    """A wall with its upper end where the photographs have theirs: many programs leave a system whose Z points downwards."""
    over = float(np.mean([view.rotation[1] @ axes.up for view in views]))
    if abs(axes.normal[2]) > _LEVEL or over > -_OVERHEAD:
        return axes
    return replace(axes, right=-axes.right, up=-axes.up)


def facade_plane(seen: SeenSurface) -> PlaneAxes:
    """The upright plane, to a degree, along which most of the surface that faces the photographs runs.

    Azimuths of the triangles' normals, modulo 180 degrees, are counted by area; the mean within 10 degrees of the densest one is
    rounded to a degree.
    """
    level = np.hypot(seen.normals[:, 0], seen.normals[:, 1])
    area = np.linalg.norm(seen.normals, axis=1)
    wall = level > 0.7 * area
    if not wall.any():
        return best_plane(seen.points, seen.camera_side)
    azimuth = np.degrees(np.arctan2(seen.normals[wall, 1], seen.normals[wall, 0])) % 180.0
    counts = np.bincount(np.minimum(azimuth.astype(int), 179), area[wall], 180)
    around = np.convolve(np.concatenate([counts[-10:], counts, counts[:10]]), np.ones(21), "valid")
    peak = float(np.argmax(around)) + 0.5
    apart = (azimuth - peak + 90.0) % 180.0 - 90.0
    near = np.abs(apart) <= 10.0
    angle = np.radians(round(peak + float(np.average(apart[near], weights=area[wall][near]))))
    normal = np.array([np.cos(angle), np.sin(angle), 0.0])
    middle = np.median(seen.points[wall][near], axis=0)
    return plane_axes(middle, normal if normal @ (seen.camera_side - middle) > 0 else -normal)


def _plane(output: PlaneOutput, seen: SeenSurface, pixel: float) -> FlatFrame:
    axes = chosen_plane(output, seen)
    oblique = None if output.towards is None else _towards(output, axes)
    if output.size is None:
        offset = seen.points - axes.point
        if oblique is not None:
            offset = offset - ((offset @ axes.normal) / (oblique @ axes.normal))[:, None] * oblique
        (left, right), (bottom, top) = _extent(offset @ axes.right), _extent(offset @ axes.up)
    else:
        width, height = output.size
        (left, right), (bottom, top) = (-0.5 * width, 0.5 * width), (-0.5 * height, 0.5 * height)
    cols, rows = max(round((right - left) / pixel), 1), max(round((top - bottom) / pixel), 1)
    _refuse_edge_on(output, axes, seen)
    return FlatFrame(
        name=output.name,
        rows=rows,
        cols=cols,
        corner=vector(axes.point + left * axes.right + top * axes.up),
        right=vector(axes.right),
        up=vector(axes.up),
        normal=vector(axes.normal),
        pixel=pixel,
        oblique=None if oblique is None else vector(oblique),
    )


def _towards(output: PlaneOutput, axes: PlaneAxes) -> np.ndarray:
    """The unit vector towards the viewer of an oblique projection. Raises GeometryError where it runs along or behind the plane."""
    towards = np.array(output.towards, np.float64)
    length = float(np.linalg.norm(towards))
    if length == 0.0 or (towards @ axes.normal) / length < _STEEPEST:
        raise GeometryError(
            f"The direction `towards` of '{output.name}' does not lead in front of its plane, whose normal is "
            f"{_listed(axes.normal)}; give one that is less than 80 degrees from it."
        )
    return towards / length


def _refuse_edge_on(output: PlaneOutput, axes: PlaneAxes, seen: SeenSurface) -> None:
    """Raises GeometryError where all of the surface lies across the plane of an output."""
    turned = float(np.abs(seen.normals @ axes.normal).sum()) / max(float(np.linalg.norm(seen.normals, axis=1).sum()), 1e-300)
    if turned < _EDGE_ON:
        # The direction in which most of the area faces, whichever way round its triangles are stored.
        most = np.linalg.eigh(seen.normals.T @ seen.normals)[1][:, 2]
        most = most if most @ (seen.camera_side - axes.point) > 0 else -most
        raise GeometryError(
            f"The plane of '{output.name}' is edge-on: the surface is turned towards its normal {_listed(axes.normal)} by "
            f"{np.degrees(np.arcsin(turned)):.1f} degrees on average. Most of the surface faces {_listed(most)}: give that as "
            "the normal, or `plane: {kind: facade}`."
        )


def _listed(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in np.round(values, 2) + 0.0) + ")"


def _cylinder(output: CylinderOutput, pixel: float) -> CylinderFrame:
    axis = np.array(output.head) - output.foot
    height = float(np.linalg.norm(axis))
    if height <= 0.0:
        raise GeometryError(f"The ends of the axis of '{output.name}' are the same point; give its foot and its head.")
    axis = axis / height
    # The middle column faces south, as far as the axis lets it: north is at both ends.
    middle = np.array([0.0, -1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    middle = middle - (middle @ axis) * axis
    return CylinderFrame(
        name=output.name,
        rows=max(round(height / pixel), 1),
        cols=max(round(2 * np.pi * output.radius / pixel), 1),
        foot=output.foot,
        axis=vector(axis),
        middle=vector(middle / np.linalg.norm(middle)),
        radius=output.radius,
        reach=output.reach * output.radius,
        top=height,
        outside=output.seen_from == "outside",
        pixel=pixel,
    )


def looking_at(position: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Rotation (3, 3), world to image, of a camera at `position` with `target` in its middle and upright objects upright."""
    back = position - target
    axes = plane_axes(target, back)
    return np.array([axes.right, axes.up, axes.normal])


def _attitude(output: PerspectiveOutput) -> np.ndarray:
    """Rotation (3, 3), world to image, of a view."""
    if output.rotation is not None:
        return np.array(output.rotation)
    if output.omega_phi_kappa is not None:
        return rotation_matrix(*np.radians(output.omega_phi_kappa))
    position, target = np.array(output.position), np.array(output.target)
    if np.array_equal(position, target):
        raise GeometryError(f"The view '{output.name}' looks at its own position; give another `target`.")
    roll = np.radians(output.roll)
    turned = np.array([[np.cos(roll), -np.sin(roll), 0.0], [np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    return turned @ looking_at(position, target)


def _perspective(output: PerspectiveOutput) -> ViewFrame:
    omega, phi, kappa = np.degrees(angles(_attitude(output)))
    camera = Camera(
        name=output.name, width=output.width, height=output.height, c=output.c, x0=output.x0, y0=output.y0, lens=output.lens_model
    )
    return ViewFrame(
        name=output.name,
        rows=output.height,
        cols=output.width,
        camera=camera,
        omega_phi_kappa=(float(omega), float(phi), float(kappa)),
        centre=output.position,
    )


def photograph_frame(name: str, photo: str, block: Block, distorted: bool, itself: bool, halvings: int = 0) -> ViewFrame:
    """The frame of a photograph of the block, halved so many times. Raises GeometryError for one that it does not have."""
    if photo not in block.names:
        raise GeometryError(f"The photograph '{photo}' of the output '{name}' is not oriented; there are {some_of(block.names)}.")
    camera, pose = block.camera_of(photo), block.of(photo)
    if not distorted:
        camera = camera.model_copy(update={"lens": BrownLens()})
    camera = halved(camera, halvings)
    return ViewFrame(
        name=name,
        rows=camera.height,
        cols=camera.width,
        without=() if itself else (photo,),
        camera=camera,
        omega_phi_kappa=pose.omega_phi_kappa,
        centre=pose.centre,
    )


def left_out_frame(block: Block, photo: str, number: int, pixels: int, levels: int) -> ViewFrame:
    """The frame in which a photograph is made again from the others: the finest of its `levels` with at most so many pixels."""
    camera = block.camera_of(photo)
    halvings = 0
    while halvings + 1 < levels and camera.width * camera.height > pixels * 4**halvings:
        halvings += 1
    return photograph_frame(f"left_out_{number}", photo, block, distorted=True, itself=False, halvings=halvings)


def halved(camera: Camera, times: int) -> Camera:
    """The camera of a level of a photograph's pyramid."""
    for _ in range(times):
        width, height = -(-camera.width // 2), -(-camera.height // 2)
        # Pixel k of a level covers 2k and 2k + 1, so that the corner stays; a last odd pixel moves the middle.
        col = 0.5 * (camera.x0 + (camera.width - 1) / 2) - 0.25
        row = 0.5 * ((camera.height - 1) / 2 - camera.y0) - 0.25
        size = {"width": width, "height": height, "c": 0.5 * camera.c}
        camera = camera.model_copy(update={**size, "x0": col - (width - 1) / 2, "y0": (height - 1) / 2 - row})
    return camera
