"""The surface in space, as one file and as 3D Tiles, read back by trimesh."""

import json
from io import BytesIO

import numpy as np
import pytest
import rasterio
import trimesh
from pyproj import Transformer
from rasterio.transform import from_origin

from orthomill.pipeline.cli.commands.product_commands import _Methods
from orthomill.pipeline.cli.export_kinds import Asked, export_as
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.schemas.errors import StoreError, WorkflowError

WEST, NORTH, ROWS, COLS = 407000.0, 4357600.0, 200, 300


@pytest.fixture
def folder(tmp_path):
    """A run with a surface of 1 m, a hill, without heights in the south-east; its orthoimage is red in the east."""
    (tmp_path / "products").mkdir()
    col, row = np.meshgrid(np.arange(COLS), np.arange(ROWS))
    z = height(WEST + col + 0.5, NORTH - row - 0.5).astype(np.float32)
    z[150:, 250:] = np.nan
    profile = {"driver": "GTiff", "crs": "EPSG:2100", "transform": from_origin(WEST, NORTH, 1, 1)}
    with rasterio.open(
        tmp_path / "products/dsm.tif", "w", width=COLS, height=ROWS, count=1, dtype="float32", nodata=np.nan, **profile
    ) as target:
        target.write(z, 1)
    rgba = np.full((4, 2 * ROWS, 2 * COLS), 255, np.uint8)
    rgba[:3] = 0
    rgba[0, :, COLS:] = 200
    profile["transform"] = from_origin(WEST, NORTH, 0.5, 0.5)
    with rasterio.open(
        tmp_path / "products/ortho.tif", "w", width=2 * COLS, height=2 * ROWS, count=4, dtype="uint8", **profile
    ) as target:
        target.write(rgba)
        target.colorinterp = [rasterio.enums.ColorInterp[name] for name in ("red", "green", "blue", "alpha")]
    return tmp_path


def height(x, y):
    return 100 + 8 * np.sin((x - WEST) / 40) + 5 * np.cos((y - NORTH) / 30)


def made(folder, kind, **how):
    return export_as(Asked(kind, None, Wanted(**how), None), folder, _Methods())


def parts(data: bytes, origin):
    """(vertices on the map, colours above them) of a GLB, Z up again."""
    scene = trimesh.load(BytesIO(data), file_type="glb")
    for name in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[name]
        mesh = scene.geometry[geometry]
        x, y, z = trimesh.transformations.transform_points(mesh.vertices, matrix).T
        picture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
        u, v = mesh.visual.uv.T
        at = np.clip((v * 0 + 1 - v) * picture.shape[0], 0, picture.shape[0] - 1).astype(int)
        colours = picture[at, np.clip(u * picture.shape[1], 0, picture.shape[1] - 1).astype(int)]
        yield np.column_stack([x, -z, y]) + origin, colours


def about(data: bytes) -> dict:
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size])["asset"]["extras"]


def test_the_surface_stands_where_it_is_on_the_map_with_the_colours_above_it(folder):
    data = made(folder, "glb").read_bytes()
    found = list(parts(data, about(data)["origin"]))
    places, colours = np.concatenate([p for p, _ in found]), np.concatenate([c for _, c in found])
    assert len(found) == 6 and "2100" in about(data)["crs"]
    assert np.abs(places[:, 2] - height(places[:, 0], places[:, 1])).max() < 1e-3
    middle = np.abs(places[:, 0] - WEST - COLS / 2) > 3
    assert ((colours[:, 0] > 100) == (places[:, 0] > WEST + COLS / 2))[middle].all()
    assert len(np.unique(places[:, :2], axis=0)) == ROWS * COLS - 50 * 50
    assert not ((places[:, 0] > WEST + 250) & (places[:, 1] < NORTH - 150)).any()


def nodes(node):
    yield node
    for child in node.get("children", ()):
        yield from nodes(child)


def test_tiles_have_levels_whose_boxes_hold_them_and_a_place_on_the_earth(folder):
    path = made(folder, "3dtiles")
    tree = json.loads((path / "tileset.json").read_text())
    root = tree["root"]
    assert tree["asset"]["version"] == "1.1" and tree["geometricError"] > root["geometricError"] > 0
    turn = np.reshape(root["transform"], (4, 4)).T
    origin = tree["asset"]["extras"]["origin"]
    to_earth = Transformer.from_crs(4979, 4978, always_xy=True)
    lon, lat = Transformer.from_crs("EPSG:2100", "EPSG:4326", always_xy=True).transform(*origin[:2])
    # Two dimensions of a system with another datum: its transformation leaves the height out.
    assert np.abs(turn[:3, 3] - to_earth.transform(lon, lat, 0.0)).max() < 30
    files = set()
    for node in nodes(root):
        middle, half = np.array(node["boundingVolume"]["box"][:3]), np.array(node["boundingVolume"]["box"][3:]).reshape(3, 3)
        assert all(child["geometricError"] < node["geometricError"] for child in node.get("children", ()))
        uri = node["content"]["uri"]
        files.add(uri)
        for places, _ in parts((path / uri).read_bytes(), np.zeros(3)):
            assert (np.abs(places - middle) <= np.diag(half) + 1e-3).all()
            level = int(uri.split("/")[1].split("-")[0])
            surface = places[:, 2] - height(places[:, 0] + origin[0], places[:, 1] + origin[1])
            # Coarser cells are means of finer ones; the skirts hang below.
            assert np.median(np.abs(surface)) < 0.02 * 4**level and surface.max() < 0.2 * 4**level
    assert files == {one.relative_to(path).as_posix() for one in path.rglob("*.glb")} and len(files) > 7


def test_a_part_of_it_in_another_system_and_cell(folder):
    area = (WEST + 50, NORTH - 100, WEST + 100, NORTH - 60)
    data = made(folder, "glb", area=area, cell=2.0).read_bytes()
    places = np.concatenate([p for p, _ in parts(data, about(data)["origin"])])
    assert places[:, :2].min(axis=0) == pytest.approx([WEST + 51, NORTH - 99], abs=2) and len(places) <= 26 * 21
    assert "32634" in about(made(folder, "glb", crs="EPSG:32634", cell=4.0).read_bytes())["crs"]


def test_what_cannot_stand_in_space_is_told(folder):
    with pytest.raises(WorkflowError, match="needs a system in metres"):
        made(folder, "glb", crs="EPSG:4326")
    with pytest.raises(WorkflowError, match="No height lies"):
        made(folder, "3dtiles", area=(WEST + 260, NORTH - 200, WEST + 300, NORTH - 160))
    (folder / "products/ortho.tif").unlink()
    with pytest.raises(StoreError, match="has no orthoimage to lay on dsm"):
        made(folder, "glb")
    assert list((folder / "products/exported").iterdir()) == []
