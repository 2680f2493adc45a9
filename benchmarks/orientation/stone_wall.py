"""The stone wall against MicMac: its files in this project's conventions, and resection and intersection from its named points.

MicMac's camera is taken as it is. From the named points alone all four photographs are resected (and the points adjusted with
them); the other way round, the points are intersected with MicMac's orientation. The source states no errors: 1 cm and 2 px are
what MicMac's own orientation leaves at the points.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.orientation.orientation_truth import Pose, micmac_poses
from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.network import Interior, Network, Rays, State
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.geometry.fixed_intersection import Measured, intersect_fixed
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector, vector_of_rotation
from orthomill.tasks.geometry.view import View

SIZE = (1728, 1152)
"""Width and height of the files; EXIF (8) turns the photographs upright."""
POINT_SIGMA, PIXEL_SIGMA = 0.01, 2.0
"""m and px"""


@dataclass(frozen=True, eq=False)
class Wall:
    """`points` (n, 3) m by `names`; `measured` in pixels (col, row) of the files; poses by MicMac, and its camera."""

    names: tuple[str, ...]
    points: np.ndarray
    measured: Measured
    photos: tuple[str, ...]
    poses: dict[str, Pose]
    camera: Camera

    @property
    def views(self) -> list[View]:
        return [View(name, self.camera, *self.poses[name]) for name in self.photos]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Ours minus MicMac's: `centre`, `turn` (rad, about the axes of the image) and `point` (m), each (k, 3), with their standard
    errors by the named points alone."""

    centre: np.ndarray
    centre_sigma: np.ndarray
    turn: np.ndarray
    turn_sigma: np.ndarray
    point: np.ndarray
    point_sigma: np.ndarray

    @property
    def standardised(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.centre / self.centre_sigma, self.turn / self.turn_sigma, self.point / self.point_sigma


def read_wall(folder: Path) -> Wall:
    """The files of the folder; points without coordinates or measurements are left out."""
    ground = {
        one.findtext("NamePt").strip(): np.array(one.findtext("Pt").split(), float)
        for one in ET.parse(folder / "Ground-Pts3D.xml").iter("OneAppuisDAF")
    }
    rows = [
        (one.findtext("NamePt").strip(), Path(photo.findtext("NameIm").strip()).stem, *map(float, one.findtext("PtIm").split()))
        for photo in ET.parse(folder / "GroundMeasure.xml").iter("MesureAppuiFlottant1Im")
        for one in photo.iter("OneMesureAF1I")
    ]
    rows = [row for row in rows if row[0] in ground]
    names, photos = (tuple(sorted({row[i] for row in rows})) for i in (0, 1))
    rows.sort()
    measured = Measured(
        np.array([names.index(row[0]) for row in rows]),
        np.array([photos.index(row[1]) for row in rows]),
        np.array([row[2:] for row in rows]),
        np.full(len(rows), PIXEL_SIGMA),
    )
    orientation = folder / "micmac_orientation"
    points = np.array([ground[name] for name in names])
    return Wall(names, points, measured, photos, micmac_poses(orientation), micmac_camera(next(orientation.glob("AutoCal*.xml"))))


def micmac_camera(path: Path) -> Camera:
    """MicMac's radial polynomial (from the ideal to the observed point, px, four terms) as Brown's three in units of c, which fit
    it over the frame to some hundredths of a pixel."""
    root = ET.parse(path).getroot()
    c, (col, row) = float(root.findtext(".//F")), map(float, root.findtext(".//PP").split())
    terms = [float(one.text) for one in root.iter("CoeffDist")]
    radius = np.linspace(0.0, 0.5 * np.hypot(*SIZE), 200)
    bend = sum(k * radius ** (2 * i + 3) for i, k in enumerate(terms))
    k1, k2, k3 = np.linalg.lstsq(c * np.stack([(radius / c) ** p for p in (3, 5, 7)], axis=1), bend, rcond=None)[0]
    x0, y0 = col - (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2 - row
    return Camera(name="micmac", width=SIZE[0], height=SIZE[1], c=c, x0=x0, y0=y0, k1=k1, k2=k2, k3=k3)


def control_texts(wall: Wall) -> tuple[str, str]:
    """The points as the two CSV texts of a workflow; measurements in the upright photographs."""
    points = ["name,role,x,y,z,sigma_x,sigma_y,sigma_z"]
    points += [
        ",".join([name, "control", *map(repr, xyz.tolist()), *[str(POINT_SIGMA)] * 3])
        for name, xyz in zip(wall.names, wall.points, strict=True)
    ]
    rows = ["name,photo,col,row,sigma"]
    for point, photo, (col, row) in zip(wall.measured.point, wall.measured.photo, wall.measured.pixels.tolist(), strict=True):
        rows.append(f"{wall.names[point]},{wall.photos[photo]},{row!r},{SIZE[0] - 1 - col!r},{PIXEL_SIGMA}")
    return "\n".join(points) + "\n", "\n".join(rows) + "\n"


def resected(wall: Wall, seed: int = 0) -> Adjustment:
    """The photographs from the named points alone, from starting values that are 0.2 m and 3 degrees off MicMac's."""
    rng, photos, interior = np.random.default_rng(seed), len(wall.photos), np.array([wall.camera.interior])
    own = wall.measured
    xy = np.column_stack([own.pixels[:, 0] - (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2 - own.pixels[:, 1]])
    rays = Rays(own.point.astype(np.int32), own.photo.astype(np.int32), xy, own.sigma)
    rough = State(
        np.array([rotation_of_vector(np.radians(3.0) * rng.standard_normal(3)) @ view.rotation for view in wall.views]),
        np.array([view.centre + 0.2 * rng.standard_normal(3) for view in wall.views]),
        wall.points.copy(),
        interior,
        np.zeros(3),
    )
    held = np.zeros((1, len(INTERIOR)), bool)
    known, nothing = np.full_like(wall.points, 1.0 / POINT_SIGMA**2), np.zeros((photos, 3))
    fixed = Interior(interior, np.zeros((1, len(INTERIOR), len(INTERIOR))), held, held)
    return adjust(Network(np.zeros(photos, np.int64), fixed, nothing, nothing, wall.points, known, np.zeros(photos)), rough, rays)


def compared(wall: Wall) -> Comparison:
    """Resection and intersection against MicMac's orientation."""
    found, views = resected(wall), wall.views
    sigma = np.array([np.sqrt(np.diag(found.exterior_covariance(i))) for i in range(len(views))])
    turn = np.array([vector_of_rotation(found.state.rotation[i] @ view.rotation.T) for i, view in enumerate(views)])
    met = intersect_fixed(views, wall.measured, len(wall.names))
    variance = np.diagonal(met.covariance, axis1=1, axis2=2) + POINT_SIGMA**2
    centre = found.state.centre - [view.centre for view in views]
    return Comparison(centre, sigma[:, :3], turn, sigma[:, 3:], wall.points - met.points, np.sqrt(variance))
