"""Reads meshes and point clouds that the user provides, as they are stored: units, system and mistakes are for others to judge.

PLY, STL (ASCII and binary), OBJ, GLB and OFF are read by trimesh, LAS and LAZ by laspy. Plain text holds one vertex a line (X Y Z
and perhaps red, green, blue) and then one triangle a line: three whole numbers, counted from 0 or from 1. A first line with the
numbers of vertices and triangles is optional; without triangles the text is a point cloud.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.solid.mesh import TriangleMesh

MESH_SUFFIXES = (".ply", ".stl", ".obj", ".glb", ".off")
CLOUD_SUFFIXES = (".las", ".laz")
TEXT_SUFFIXES = (".xyz", ".txt", ".asc", ".csv")
_KNOWN = ", ".join((*MESH_SUFFIXES, *CLOUD_SUFFIXES, *TEXT_SUFFIXES))


def read_mesh(path: Path) -> TriangleMesh:
    """The mesh or point cloud of a file. Raises WorkflowError."""
    reader = _reader(path)
    if not path.is_file():
        raise WorkflowError(f"The surface {path} does not exist; correct its path in the workflow.")
    try:
        return reader(path)
    # Whatever a library of formats meets in a damaged file: each has errors of its own, and none is a defect of this program.
    except Exception as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise WorkflowError(
            f"{path} cannot be read as a mesh ({reason}); export it again, as binary PLY if the program offers it."
        ) from None


def _reader(path: Path) -> Callable[[Path], TriangleMesh]:
    suffix = path.suffix.lower()
    readers = {_read_by_trimesh: MESH_SUFFIXES, _read_cloud: CLOUD_SUFFIXES, _read_text: TEXT_SUFFIXES}
    for reader, suffixes in readers.items():
        if suffix in suffixes:
            return reader
    raise WorkflowError(f"{path} is no mesh that can be read: its name ends with '{suffix}', known are {_KNOWN}; convert it.")


def _read_by_trimesh(path: Path) -> TriangleMesh:
    import trimesh  # here and below: it takes longer to load than a second run of a project takes to plan

    # Neither merged nor mended: what is wrong with a mesh is counted where it is mended, and told.
    loaded: Any = trimesh.load(path, process=False, maintain_order=True, skip_materials=True)
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_geometry()
    triangles = np.asarray(getattr(loaded, "faces", np.zeros((0, 3))), np.int32).reshape(-1, 3)
    vertices = np.asarray(loaded.vertices, np.float64).reshape(-1, 3)
    return TriangleMesh(vertices, triangles, colours=_colours(loaded, len(vertices)))


def _colours(loaded: Any, count: int) -> np.ndarray | None:
    """Colours (count, 3) of vertices, where the file has them."""
    import trimesh

    visual = getattr(loaded, "visual", None)
    found = loaded.colors if isinstance(loaded, trimesh.PointCloud) else getattr(visual, "vertex_colors", None)
    stored = isinstance(loaded, trimesh.PointCloud) or getattr(visual, "kind", None) == "vertex"
    return np.asarray(found, np.uint8)[:, :3] if stored and found is not None and len(found) == count else None


def _read_cloud(path: Path) -> TriangleMesh:
    import laspy

    cloud = laspy.read(path)
    points = np.column_stack([np.asarray(cloud[axis], np.float64) for axis in ("x", "y", "z")])
    return TriangleMesh(points, np.zeros((0, 3), np.int32))


def _read_text(path: Path) -> TriangleMesh:
    text = path.read_text(encoding="utf-8-sig").replace(",", " ").replace(";", " ")
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "//"))]
    if not lines:
        raise ValueError("it is empty")
    count = _vertex_count(lines)
    first = 1 if lines and len(lines[0].split()) == 2 else 0
    vertices = np.loadtxt(lines[first : first + count], ndmin=2)
    rest = lines[first + count :]
    triangles = np.loadtxt(rest, dtype=np.int64, ndmin=2)[:, :3] if rest else np.zeros((0, 3), np.int64)
    # From 1: the last vertex is then one beyond the others, and none is called 0.
    if triangles.size and triangles.min() > 0 and triangles.max() == len(vertices):
        triangles -= 1
    colours = vertices[:, 3:6].astype(np.uint8) if vertices.shape[1] >= 6 else None
    return TriangleMesh(np.ascontiguousarray(vertices[:, :3]), triangles.astype(np.int32), colours=colours)


def _vertex_count(lines: list[str]) -> int:
    """The number of lines with vertices: as the first line says, or all before the last lines of whole numbers."""
    if lines and len(lines[0].split()) == 2:
        return int(lines[0].split()[0])
    count = len(lines)
    while count and "." not in lines[count - 1] and len(lines[count - 1].split()) == 3:
        count -= 1
    # Whole metres throughout: points, not triangles.
    return count or len(lines)
