"""What a surveyor and a scanner bring home from the portal: targets in the photographs, and a mesh with noise and holes."""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.truth import ControlRows, MeasurementRows
from orthomill.tasks.simulation.portal.portal_block import portal_views, to_system
from orthomill.tasks.simulation.portal.portal_casting import facets_of
from orthomill.tasks.simulation.portal.portal_mesh import PortalMesh, portal_mesh
from orthomill.tasks.simulation.portal.portal_rendering import lit_scene, scene_of_photograph, seen_from, sees
from orthomill.tasks.simulation.portal.portal_targets import CONTROL, TARGETS

_SURVEY, _SCAN = 41, 42  # streams of random numbers of the seed
_SCANNER = np.array([[-2.4, -5.0, 1.7], [2.6, -4.6, 1.7], [0.2, -5.4, 1.9]])
"""Where the scanner stood, m along the portal's axes"""
_STEEPEST = 0.16
"""Cosine of the angle at which its beam may graze a surface"""
_REACH = (3.25, 6.3)
"""m to the sides and upwards that were scanned"""


class ScanText(BaseModel):
    """A mesh as the text of an ASCII PLY file."""

    model_config = ConfigDict(frozen=True)

    text: str


def survey_portal(seed: int, reduction: float, sigmas: tuple[float, float]) -> tuple[ControlRows, MeasurementRows]:
    """Surveyed targets and their measurements in the photographs that see them, with normal errors of `sigmas` m and px."""
    generator = np.random.default_rng([seed, _SURVEY])
    true = to_system(TARGETS)
    x, y, z = (true + generator.normal(0.0, sigmas[0], true.shape)).round(4).T
    names = np.array([f"{'CO' if k < CONTROL else 'CH'}{k + 1:02d}" for k in range(len(TARGETS))], str)
    roles = np.array(["control" if k < CONTROL else "check" for k in range(len(TARGETS))], str)
    sigma = np.full(len(TARGETS), sigmas[0])
    rows = []
    for number, view in enumerate(portal_views(reduction)):
        # People and leaves hide targets as well; just before the surface, which would hide them by rounding.
        seen = sees(scene_of_photograph(view, number, seed), view, TARGETS - (0.0, 0.002, 0.0))
        pixels = view.project(true) + generator.normal(0.0, sigmas[1], (len(true), 2))
        rows += [(names[k], view.name, *pixels[k].round(3), sigmas[1]) for k in np.flatnonzero(seen)]
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return ControlRows(name=names, role=roles, x=x, y=y, z=z, sigma_x=sigma, sigma_y=sigma, sigma_z=sigma), MeasurementRows(
        *columns
    )


def scanned_portal(seed: int, cell: float, noise: float) -> PortalMesh:
    """The mesh of the scans: the portal in triangles of `cell` m with errors of `noise` m across the surface, where a scanner saw
    it not too steeply. Vertices are in the surveyor's system."""
    mesh, scene = portal_mesh(cell), lit_scene()
    facets = facets_of(mesh.vertices, mesh.triangles)
    normals = facets.normals
    middle = mesh.vertices[mesh.triangles].mean(axis=1)
    near = (np.abs(middle[:, 0]) < _REACH[0]) & (middle[:, 2] < _REACH[1]) & (middle[:, 1] > -3.2)
    kept = np.zeros(len(middle), bool)
    for station in _SCANNER:
        away = station - middle
        facing = (away * normals).sum(axis=1) / np.linalg.norm(away, axis=1)
        wanted = near & ~kept & (facing > _STEEPEST)
        kept[wanted] = seen_from(scene, station, middle[wanted] + 0.003 * normals[wanted])
    triangles = mesh.triangles[kept]
    used, number = np.unique(triangles, return_inverse=True)
    vertices = _noisy(mesh.vertices[used], noise, np.random.default_rng([seed, _SCAN]))
    return PortalMesh(to_system(vertices), number.reshape(-1, 3).astype(np.int32), mesh.place[used], mesh.material[kept])


def _noisy(vertices: np.ndarray, noise: float, generator: np.random.Generator) -> np.ndarray:
    """Vertices with errors along the beam; those at the same place have the same one, so that patches stay joined."""
    key = np.round(vertices, 4)
    _, first, same = np.unique(key, axis=0, return_index=True, return_inverse=True)
    beam = vertices[first] - _SCANNER[2]
    beam /= np.linalg.norm(beam, axis=1, keepdims=True)
    moved = vertices[first] + beam * generator.normal(0.0, noise, len(first))[:, None]
    return moved[same.ravel()]


def scan_text(mesh: PortalMesh) -> ScanText:
    """The mesh as ASCII PLY, millimetre tenths."""
    head = (
        f"ply\nformat ascii 1.0\ncomment scanned portal, metres\nelement vertex {len(mesh.vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(mesh.triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = "\n".join(f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in mesh.vertices.tolist())
    faces = "\n".join(f"3 {a} {b} {c}" for a, b, c in mesh.triangles.tolist())
    return ScanText(text=f"{head}{vertices}\n{faces}\n")
