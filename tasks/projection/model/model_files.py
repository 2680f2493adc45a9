"""The files of the coloured mesh: PLY with colours of vertices, one GLB of all tiles, the tileset, and the page to look at it."""

import base64
import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import FileBytes
from orthomill.schemas.orientation import Block
from orthomill.schemas.solid.census import MeshCensus, MeshTriangles, MeshVertices
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.geometry.topocentric import geocentric_matrix
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.projection.model.glb import ModelPart, as_glb, as_jpeg, from_jpeg, glb_parts
from orthomill.tasks.projection.model.model_colours import UNSEEN, ColouredCorners
from orthomill.tasks.visibility.mesh_blocks import BlockBox

PAGE_TEXELS = 6_000_000
"""texels of all textures in the page: beyond, they are halved"""
_PAGE_QUALITY = 85
_FINE = 2**16  # steps of coordinates in the page, over the size of the model: they compress to half


class PageText(BaseModel):
    """A page or a description as text."""

    model_config = ConfigDict(frozen=True)

    text: str


def coloured_ply(
    vertices: MeshVertices,
    triangles: MeshTriangles,
    census: MeshCensus,
    facing: MeshFacing,
    corners: Iterator[ColouredCorners],
    crs: str,
) -> FileBytes:
    """The whole mesh, binary, with coordinates of the project in 64 bits and the mean colour of each vertex over its blocks."""
    numbers = np.column_stack([triangles.a, triangles.b, triangles.c])
    sums, first = np.zeros((len(vertices), 4), np.uint32), 0
    for part in corners:
        colours = part.colours.reshape(-1, 4)
        known = colours[:, 3] > 0
        # Only the vertices of the block: arrays of all of them for each block would take the square of the mesh.
        own, place = np.unique(numbers[first : first + len(colours) // 3].ravel()[known], return_inverse=True)
        for k in range(3):
            sums[own, k] += np.bincount(place, colours[known, k], len(own)).astype(np.uint32)
        sums[own, 3] += np.bincount(place, minlength=len(own)).astype(np.uint32)
        first += len(colours) // 3
    return FileBytes(_ply(vertices, numbers[:, ::-1] if facing.sign < 0 else numbers, census, sums, crs))


def _ply(vertices: MeshVertices, numbers: np.ndarray, census: MeshCensus, sums: np.ndarray, crs: str) -> np.ndarray:
    """The file (uint8), filled in place: a mesh of millions of triangles is held once."""
    header = np.frombuffer(_ply_header(len(vertices), len(numbers), crs), np.uint8)
    of_vertex, of_face = np.dtype([("p", "<f8", 3), ("c", "u1", 3)]), np.dtype([("n", "u1"), ("v", "<i4", 3)])
    ends = np.cumsum([len(header), of_vertex.itemsize * len(vertices), of_face.itemsize * len(numbers)])
    out = np.empty(ends[2], np.uint8)
    out[: ends[0]] = header
    rows, faces = out[ends[0] : ends[1]].view(of_vertex), out[ends[1] :].view(of_face)
    seen = sums[:, 3] > 0
    for k, axis in enumerate((vertices.x, vertices.y, vertices.z)):
        rows["p"][:, k] = axis + census.origin[k]
        rows["c"][:, k] = np.where(seen, np.rint(sums[:, k] / np.maximum(sums[:, 3], 1)), UNSEEN)
    faces["n"], faces["v"] = 3, numbers
    return out


def _ply_header(vertices: int, faces: int, crs: str) -> bytes:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment orthomill; reference system {crs}; unit m; what no photograph sees is grey {UNSEEN}",
        f"element vertex {vertices}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        f"element face {faces}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode()


def whole_glb(tiles: Iterator[FileBytes], extras: dict[str, Any]) -> FileBytes:
    """All tiles as one file, a part and a texture for each."""
    return FileBytes.of(as_glb([part for tile in tiles for part in glb_parts(tile.content.tobytes())], extras))


@dataclass(frozen=True)
class TreeNode:
    """A tile of the tileset: its file, the box about it, by how much it deviates from the mesh (m), and its finer tiles."""

    uri: str
    box: BlockBox
    error: float
    children: tuple["TreeNode", ...] = ()


def tileset(root: TreeNode, census: MeshCensus, crs: str) -> PageText:
    """3D Tiles 1.1: GLB tiles, from coarse to fine, at their place on the earth."""
    matrix = geocentric_matrix(crs, np.array(census.origin))
    content = {
        "asset": {"version": "1.1", "generator": "orthomill", "extras": {"crs": crs, "origin": census.origin}},
        # What is seen if nothing is drawn: the whole size of the object.
        "geometricError": census.size,
        "root": {"transform": matrix.T.ravel().tolist(), **_node(root)},
    }
    return PageText(text=json.dumps(content, indent=1) + "\n")


def _node(node: TreeNode) -> dict[str, Any]:
    middle = 0.5 * np.add(node.box.high, node.box.low)
    half = np.maximum(0.5 * np.subtract(node.box.high, node.box.low), 1e-6)
    out: dict[str, Any] = {
        "boundingVolume": {"box": [*middle.tolist(), *np.diag(half).ravel().tolist()]},
        "geometricError": node.error,
        "refine": "REPLACE",
        "content": {"uri": node.uri},
    }
    if node.children:
        out["children"] = [_node(child) for child in node.children]
    return out


# --- the page ----------------------------------------------------------------------------------------------------------------


def view_page(tiles: Iterator[FileBytes], block: Block, census: MeshCensus, names: tuple[str, ...], title: str) -> PageText:
    """One page without network that shows the model and where the photographs were taken."""
    parts = [part for tile in tiles for part in glb_parts(tile.content.tobytes())]
    packed = zlib.compress(as_glb(_light(parts, census.size), {}), 9)
    cameras = json.dumps([_camera(block, name, np.array(census.origin)) for name in names], separators=(",", ":"))
    page = _page()
    for mark, text in (
        ("{{title}}", _escaped(title)),
        ("{{cameras}}", cameras.replace("<", "\\u003c")),
        ("{{model}}", base64.b64encode(packed).decode()),
    ):
        page = page.replace(mark, text)
    return PageText(text=page)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")


@cache
def _page() -> str:
    return (files(__package__) / "view_page.html").read_text(encoding="utf-8")


def _light(parts: list[ModelPart], size: float) -> list[ModelPart]:
    """The parts with smaller textures, and coordinates that compress well."""
    pictures = [from_jpeg(part.texture) if part.texture else None for part in parts]
    total, halvings = sum(picture.shape[0] * picture.shape[1] for picture in pictures if picture is not None), 0
    while total > PAGE_TEXELS * 4**halvings:
        halvings += 1
    step = max(size, 1e-9) / _FINE
    out = []
    for part, picture in zip(parts, pictures, strict=True):
        rounded = (np.rint(part.vertices / step) * step).astype(np.float32)
        texture = b"" if picture is None else as_jpeg(_halved(picture, halvings), _PAGE_QUALITY)
        places = None if part.places is None else np.rint(part.places * 4096) / 4096
        out.append(replace(part, vertices=rounded, texture=texture, places=places))
    return out


def _halved(picture: np.ndarray, times: int) -> np.ndarray:
    shape = max(picture.shape[1] >> times, 1), max(picture.shape[0] >> times, 1)
    return picture if times == 0 else cv2.resize(picture, shape, interpolation=cv2.INTER_AREA)


def _camera(block: Block, name: str, origin: np.ndarray) -> dict[str, Any]:
    """Where a photograph was taken, for the page: rotation row by row, half angles of its frame as tangents."""
    view = block_view(block, name)
    camera = view.camera
    return {
        "name": name,
        "at": np.round(view.centre - origin, 4).tolist(),
        "turn": np.round(view.rotation, 6).ravel().tolist(),
        "half": [round(0.5 * camera.width / camera.c, 5), round(0.5 * camera.height / camera.c, 5)],
    }
