"""The coloured mesh of a scene whose colours are known: textures, vertices, coarser levels, and what other programs read of it."""

import base64
import io
import json
import re
import zlib

import numpy as np
import pytest
import trimesh

from orthomill.schemas.job import FileBytes
from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.geometry.topocentric import geocentric_matrix
from orthomill.tasks.projection.mesh.depth_rasters import depth_picture
from orthomill.tasks.projection.model.glb import as_glb, from_jpeg, glb_parts
from orthomill.tasks.projection.model.model_colours import UNSEEN, ColouredCorners
from orthomill.tasks.projection.model.model_files import TreeNode, tileset
from orthomill.tasks.projection.model.model_levels import cell_codes, coarse_node, mean_cells
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.visibility.mesh_blocks import BlockBox
from tests.support.engine.memory_runner import MemoryProject
from tests.support.solid import wall_and_box as scene

TURN = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # from Z up to Y up
FRONT = {
    "kind": "plane",
    "name": "front",
    "plane": {"kind": "normal", "point": (0.0, 0.0, 1.5), "normal": (0.0, -1.0, 0.0)},
    "pixel": 0.1,
    "size": (4.0, 3.0),
}


def run(surface: TriangleMesh | None = None, **more) -> MemoryProject:
    project = scene.project_of(MemoryProject, surface=surface)
    given = {
        "surface": {"kind": "mesh", "path": "mesh.ply"},
        "outputs": [FRONT],
        "balance": {"kind": "none"},
        "masks": {"kind": "none"},
    }
    project.run(ProjectionStage.model_validate({**given, "leave_one_out": {"kind": "none"}, **more}))
    return project


@pytest.fixture(scope="module")
def made() -> MemoryProject:
    return run(model={"kind": "tiles", "texel": 0.025, "side": 1024})


def part_of(project: MemoryProject):
    (part,) = glb_parts(project.tables["projection/model/0-0.parquet"].content.tobytes())
    return part


def painted(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    return scene.colour(points, box)


def test_texels_have_the_colours_of_the_surface(made):
    part, census = part_of(made), made.tables["projection/census.json"]
    picture = from_jpeg(part.texture)
    # The middle of each triangle, in space and in the texture.
    points = part.vertices[part.triangles].mean(axis=1) + census.origin
    places = part.places[part.triangles].mean(axis=1) * picture.shape[0] - 0.5
    col, row = np.rint(places).astype(int).T
    found, box = picture[row, col].astype(float), points[:, 1] < -0.5
    known = np.abs(found - UNSEEN).max(axis=1) > 3
    error = np.abs(found - painted(points, box)).mean(axis=1)[known & ~box]
    assert known[~box].mean() > 0.95 and np.percentile(error, 90) < 5.0
    assert made.tables["projection/model/facts/0.json"].texel == pytest.approx(0.025, rel=0.3)


def test_vertices_of_the_ply_stand_where_they_were_in_the_colours_that_photographs_saw(made):
    loaded = trimesh.load(io.BytesIO(made.tables["projection/model/model.parquet"].content.tobytes()), "ply", process=False)
    original = scene.mesh()
    assert len(loaded.faces) == len(original.triangles) and len(loaded.vertices) == len(original.vertices)
    np.testing.assert_allclose(loaded.bounds, original.bounds, atol=1e-9)
    colours, wall = np.asarray(loaded.visual.vertex_colors)[:, :3].astype(float), np.abs(loaded.vertices[:, 1]) < 1e-6
    # At the rim of the wall a photograph's pixels are half background.
    (west, south), (east, north) = original.bounds[0][[0, 2]], original.bounds[1][[0, 2]]
    x, z = loaded.vertices[:, 0], loaded.vertices[:, 2]
    wall &= (x > west + 0.05) & (x < east - 0.05) & (z > south + 0.05) & (z < north - 0.05)
    seen = np.abs(colours - UNSEEN).max(axis=1) > 3
    error = np.abs(colours - painted(loaded.vertices, ~wall)).mean(axis=1)[seen & wall]
    assert seen[wall].mean() > 0.9 and np.percentile(error, 90) < 5.0


def test_other_programs_read_the_glb_with_y_up(made):
    content = made.tables["projection/model/whole.parquet"].content.tobytes()
    loaded = trimesh.load(io.BytesIO(content), "glb")
    census = made.tables["projection/census.json"]
    mesh = loaded.to_geometry() if isinstance(loaded, trimesh.Scene) else loaded
    placed = mesh.vertices @ TURN + census.origin
    np.testing.assert_allclose(np.sort(placed.min(axis=0)), np.sort(scene.mesh().bounds[0]), atol=1e-5)
    assert np.isclose(np.ptp(mesh.vertices[:, 1]), 3.0) and mesh.visual.kind == "texture"
    head = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    assert head["asset"]["extras"] == {"crs": "EPSG:2100", "origin": list(census.origin), "unit": "m"}


def test_a_mesh_that_faces_inwards_is_turned_in_the_files(made):
    mesh = scene.mesh()
    turned = run(TriangleMesh(mesh.vertices, mesh.triangles[:, ::-1].copy()), model={"kind": "tiles", "texel": 0.1})
    for project in (made, turned):
        loaded = trimesh.load(io.BytesIO(project.tables["projection/model/model.parquet"].content.tobytes()), "ply", process=False)
        wall = np.abs(loaded.triangles_center[:, 1]) < 1e-6
        assert (loaded.face_normals[wall] @ [0, -1, 0] > 0.99).all()


def test_the_page_holds_the_model_and_every_photograph_and_loads_nothing(made):
    page = made.tables["projection/model/page.json"].text
    poses = json.loads(re.search(r'id="poses">(.*?)</script>', page, re.S).group(1))
    block = scene.block()
    assert [pose["name"] for pose in poses] == list(scene.NAMES)
    origin = np.array(made.tables["projection/census.json"].origin)
    np.testing.assert_allclose(np.array([pose["at"] for pose in poses]) + origin, [p.centre for p in block.photos], atol=1e-3)
    packed = re.search(r'id="model">(.*?)</script>', page, re.S).group(1)
    (part,) = glb_parts(zlib.decompress(base64.b64decode(packed)))
    assert len(part.triangles) == len(scene.mesh().triangles) and part.texture
    assert "://" not in page and "{{" not in page


def test_no_model_and_no_pictures_where_none_are_wanted(made):
    bare = run(model={"kind": "none"}, depth_pictures=False)
    assert not [path for path in bare.tables if "/model/" in path] and not [name for name in bare.rasters if "picture" in name]
    paths = {export.path for export in made.exports.values()}
    assert {"products/model.ply", "products/model.glb", "products/model.html", "products/model/tileset.json"} <= paths
    assert {"products/depth/a.png", "products/depth/front.png", "products/model/tiles/0-0.glb"} <= paths
    listed = {product.path for product in made.tables["projection/report.json"].products}
    assert {"products/model.html", "products/model.glb"} <= listed


def test_depth_pictures_run_from_white_to_black(made, record_property):
    picture, nearness = made.rasters["projection/photographs/a/picture"], made.rasters["projection/photographs/a/nearness"]
    shown = nearness > 0
    record_property("found", f"{picture[shown, 0].min()} to {picture[shown, 0].max()}")
    assert (picture[shown, 0].min(), picture[shown, 0].max()) == (0, 255)
    assert np.array_equal(picture[..., 3] > 0, shown)
    assert (picture[np.unravel_index(np.argmax(nearness), nearness.shape)] == 255).all()
    depth = 1 / nearness[shown].astype(float)
    expected = 255 * (depth.max() - depth) / np.ptp(depth)
    np.testing.assert_allclose(picture[shown, 0], expected, atol=0.51)


def test_a_depth_picture_of_a_tile_takes_the_range_of_the_whole():
    nearness = np.array([[0.0, -1.0], [np.nan, -4.0]], np.float32)
    picture = depth_picture(nearness, central=False, near=(-8.0, 0.0))
    assert picture[..., 0].tolist() == [[255, 223], [0, 128]] and picture[1, 0, 3] == 0
    assert not depth_picture(np.full((2, 2), -np.inf, np.float32), central=True).any()


# --- coarser levels ----------------------------------------------------------------------------------------------------------


def sheet(west: float, side: int = 40) -> ColouredCorners:
    """A square metre from `west` on, 2 side^2 triangles, red to the east."""
    x, y = np.meshgrid(np.linspace(west, west + 1, side + 1), np.linspace(0, 1, side + 1))
    points = np.stack([x, y, 0.1 * np.sin(3 * x)], axis=2)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    corners = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (b, d, c))])
    colours = np.full((*corners.shape[:2], 4), 255)
    colours[..., 0] = 100 * corners[..., 0]
    return ColouredCorners.of(corners, colours)


FACING = MeshFacing(sign=1.0, turned=False, photos=())


def test_a_coarser_level_has_a_quarter_of_the_triangles_at_their_places_and_its_nodes_meet():
    parts, cell = [sheet(0.0), sheet(1.0)], np.sqrt(2 * 2.0 / (6400 / 4))
    cells = mean_cells(iter(parts), cell)
    nodes = [coarse_node((part,), cells, FACING, cell, {}) for part in parts]
    count = sum(len(node.corners) // 3 for node in nodes)
    assert 0.6 * 1600 < count < 1.4 * 1600
    corners = np.concatenate([node.corners.corners for node in nodes]).reshape(-1, 3)
    assert np.abs(corners[:, 2] - 0.1 * np.sin(3 * corners[:, 0])).max() < cell
    colours = np.concatenate([node.corners.colours for node in nodes]).reshape(-1, 4)
    assert np.abs(colours[:, 0] - 100 * corners[:, 0]).max() < 3
    # Where the two sheets meet, they have the same vertices.
    ends = [{tuple(p) for p in node.corners.corners.reshape(-1, 3).tolist()} for node in nodes]
    assert len(ends[0] & ends[1]) > 10
    (part,) = glb_parts(nodes[0].tile.content.tobytes())
    assert part.colours is not None and len(part.triangles) == len(nodes[0].corners) // 3


def test_the_order_of_parts_does_not_matter():
    parts = [sheet(0.0, 10), sheet(1.0, 10)]
    one, other = mean_cells(iter(parts), 0.11), mean_cells(iter(parts[::-1]), 0.11)
    np.testing.assert_array_equal(one.code, other.code)
    np.testing.assert_allclose(one.x, other.x, atol=1e-6)
    assert np.all(np.diff(one.code) > 0) and cell_codes(np.array([[-0.2, 0.05, 0.3]]), 0.11)[0] > 0


def test_nothing_left_of_a_node_is_an_empty_file():
    small = ColouredCorners.of(np.zeros((1, 3, 3)), np.zeros((1, 3, 4)))
    node = coarse_node((small,), mean_cells(iter([small]), 1.0), FACING, 1.0, {})
    assert len(node.corners) == 0 and glb_parts(node.tile.content.tobytes()) == ()
    assert isinstance(node.tile, FileBytes) and as_glb([], {})[:4] == b"glTF"


CENSUS = MeshCensus(
    vertices=3, triangles=1, read=1, median_edge=1.0, origin=(476000.0, 4204000.0, 50.0), low=(0, 0, 0), high=(3, 4, 0)
)


def test_the_tileset_stands_on_the_earth_and_grows_finer_inwards():
    box = BlockBox(low=(0.0, 0.0, 0.0), high=(2.0, 4.0, 6.0))
    text = tileset(TreeNode("tiles/1-0.glb", box, 0.4, (TreeNode("tiles/0-0.glb", box, 0.0),)), CENSUS, "EPSG:2100").text
    content = json.loads(text)
    assert content["asset"]["version"] == "1.1" and content["geometricError"] == pytest.approx(5.0)
    root = content["root"]
    assert root["geometricError"] > root["children"][0]["geometricError"] == 0.0
    assert root["boundingVolume"]["box"] == [1, 2, 3, 1, 0, 0, 0, 2, 0, 0, 0, 3]
    matrix = np.array(root["transform"]).reshape(4, 4).T
    np.testing.assert_allclose(matrix, geocentric_matrix("EPSG:2100", np.array(CENSUS.origin)))


def test_a_place_on_the_map_is_its_place_on_the_earth():
    from pyproj import Transformer

    point = np.array([476000.0, 4204000.0, 50.0])
    matrix = geocentric_matrix("EPSG:2100", point)
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
    lon, lat, _ = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*matrix[:3, 3])
    x, y = Transformer.from_crs("EPSG:4326", "EPSG:2100", always_xy=True).transform(lon, lat)
    assert (x, y) == pytest.approx(tuple(point[:2]), abs=0.01)
    # Up is up, to the deviation between ellipsoids.
    up = np.array(
        [
            np.cos(np.radians(lat)) * np.cos(np.radians(lon)),
            np.cos(np.radians(lat)) * np.sin(np.radians(lon)),
            np.sin(np.radians(lat)),
        ]
    )
    assert matrix[:3, 2] @ up > 1 - 1e-8
