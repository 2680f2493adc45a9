"""Parts of the coloured mesh as GLB (glTF 2.0 in one file), with a texture each or with colours of their vertices.

Colours are what photographs saw, light included: the material is unlit, where a program knows that extension. Y is up in glTF: a
node above all parts turns them. Coordinates are float32 relative to an origin, which `extras` of the asset state with their system.
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

UP = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
"""the matrix, column by column, from Z up to Y up"""
QUALITY = 92
"""of textures as JPEG"""
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UINT32, _UINT8, _VERTICES, _INDICES = 5126, 5125, 5121, 34962, 34963


@dataclass(frozen=True, eq=False)
class ModelPart:
    """Triangles (T, 3) between vertices (V, 3), m relative to the model's origin, Z up.

    Either places (V, 2) in a texture (0 to 1 from its upper left corner) with the texture as JPEG, or colours (V, 3) uint8.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    places: np.ndarray | None = None
    texture: bytes = b""
    colours: np.ndarray | None = None


def as_jpeg(pixels: np.ndarray, quality: int = QUALITY) -> bytes:
    """Pixels (rows, cols, 3) red, green, blue as JPEG."""
    # Texels of neighbouring charts differ: colours at half the resolution would bleed.
    settings = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(pixels[..., ::-1]), settings)
    return bytes(data)


def from_jpeg(data: bytes) -> np.ndarray:
    """Pixels (rows, cols, 3) red, green, blue of a JPEG."""
    return np.ascontiguousarray(np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))[..., ::-1])


class _Buffer:
    """The binary chunk, and the views and accessors that point into it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, data: bytes, target: int | None = None) -> int:
        """The number of a view of `data`."""
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += data
        return len(self.views) - 1

    def accessor(self, values: np.ndarray, kind: str, component: int, target: int, **more: Any) -> int:
        """The number of an accessor of rows of `values`."""
        view = self.view(np.ascontiguousarray(values).tobytes(), target)
        count = values.size if kind == "SCALAR" else len(values)
        self.accessors.append({"bufferView": view, "componentType": component, "count": count, "type": kind, **more})
        return len(self.accessors) - 1


def as_glb(parts: Sequence[ModelPart], extras: dict[str, Any]) -> bytes:
    """The parts in one file."""
    buffer, meshes, materials, textures, images = _Buffer(), [], [], [], []
    for part in parts:
        material: dict[str, Any] = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}
        material["extensions"] = {"KHR_materials_unlit": {}}
        if part.texture:
            images.append({"mimeType": "image/jpeg", "bufferView": buffer.view(part.texture)})
            textures.append({"source": len(images) - 1, "sampler": 0})
            material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": len(textures) - 1}
        materials.append(material)
        meshes.append({"primitives": [{**_primitive(part, buffer), "material": len(materials) - 1}]})
    content: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "orthomill", "extras": extras},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"matrix": UP, "children": list(range(1, len(meshes) + 1))}, *({"mesh": k} for k in range(len(meshes)))],
        "meshes": meshes,
        "materials": materials,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    if images:
        # Linear without smaller copies: charts would mix in them.
        sampler = {"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}
        content |= {"images": images, "textures": textures, "samplers": [sampler]}
    return _framed(json.dumps(content, separators=(",", ":")).encode(), bytes(buffer.data))


def _primitive(part: ModelPart, buffer: _Buffer) -> dict[str, Any]:
    vertices = np.asarray(part.vertices, np.float32)
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    attributes = {"POSITION": buffer.accessor(vertices, "VEC3", _FLOAT, _VERTICES, min=low, max=high)}
    if part.places is not None:
        attributes["TEXCOORD_0"] = buffer.accessor(np.asarray(part.places, np.float32), "VEC2", _FLOAT, _VERTICES)
    if part.colours is not None:
        # Four bytes a vertex: rows of a buffer begin at multiples of four.
        opaque = np.column_stack([part.colours, np.full(len(part.colours), 255)]).astype(np.uint8)
        attributes["COLOR_0"] = buffer.accessor(opaque, "VEC4", _UINT8, _VERTICES, normalized=True)
    indices = buffer.accessor(np.asarray(part.triangles, np.uint32).ravel(), "SCALAR", _UINT32, _INDICES)
    return {"attributes": attributes, "indices": indices, "mode": 4}


def _framed(content: bytes, data: bytes) -> bytes:
    content += b" " * (-len(content) % 4)
    data += b"\0" * (-len(data) % 4)
    size = 12 + 8 + len(content) + 8 + len(data)
    return b"".join(
        (
            struct.pack("<III", _MAGIC, 2, size),
            struct.pack("<II", len(content), _JSON),
            content,
            struct.pack("<II", len(data), _BINARY),
            data,
        )
    )


def glb_parts(data: bytes) -> tuple[ModelPart, ...]:
    """The parts of a file that `as_glb` made."""
    size = struct.unpack_from("<I", data, 12)[0]
    content, start = json.loads(data[20 : 20 + size]), 20 + size + 8

    def piece(number: int) -> bytes:
        view = content["bufferViews"][number]
        return data[start + view["byteOffset"] : start + view["byteOffset"] + view["byteLength"]]

    def rows(number: int, kind: type, width: int) -> np.ndarray:
        return np.frombuffer(piece(content["accessors"][number]["bufferView"]), kind).reshape(-1, width)

    parts = []
    for mesh, material in zip(content["meshes"], content["materials"], strict=True):
        (primitive,), painted = mesh["primitives"], material["pbrMetallicRoughness"].get("baseColorTexture")
        attributes = primitive["attributes"]
        parts.append(
            ModelPart(
                vertices=rows(attributes["POSITION"], np.float32, 3),
                triangles=rows(primitive["indices"], np.uint32, 3),
                places=rows(attributes["TEXCOORD_0"], np.float32, 2) if "TEXCOORD_0" in attributes else None,
                texture=piece(content["images"][painted["index"]]["bufferView"]) if painted else b"",
                colours=rows(attributes["COLOR_0"], np.uint8, 4)[:, :3] if "COLOR_0" in attributes else None,
            )
        )
    return tuple(parts)
