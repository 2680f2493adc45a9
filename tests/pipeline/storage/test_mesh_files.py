"""Meshes and point clouds in every format that is read: the same surface comes out of each."""

import laspy
import numpy as np
import pytest
import trimesh

from orthomill.pipeline.storage.mesh_files import read_mesh
from orthomill.schemas.errors import WorkflowError

VERTICES = np.array([[0.0, 0, 0], [1.5, 0, 0.25], [1.5, 1, 0], [0.0, 1, 0.5]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
COLOURS = np.array([[10, 20, 30], [40, 50, 60], [70, 80, 90], [100, 110, 120]], np.uint8)


def corners(mesh) -> np.ndarray:
    return mesh.vertices[mesh.triangles]


@pytest.mark.parametrize("name", ["a.ply", "ascii.ply", "a.stl", "ascii.stl", "a.obj", "a.glb", "a.off"])
def test_every_format_gives_the_same_triangles(tmp_path, name, record_property):
    written = trimesh.Trimesh(VERTICES, TRIANGLES, process=False)
    kind = name.split(".")[1]
    options = {"a.ply": {}, "ascii.ply": {"encoding": "ascii"}}.get(name, {})
    written.export(tmp_path / name, file_type="stl_ascii" if name == "ascii.stl" else kind, **options)
    worst = np.abs(corners(read_mesh(tmp_path / name)) - VERTICES[TRIANGLES]).max()
    record_property("found", f"{name} {worst:.0e} m")
    assert worst < 1e-6


def test_colours_of_vertices_are_read(tmp_path):
    trimesh.Trimesh(VERTICES, TRIANGLES, vertex_colors=COLOURS, process=False).export(tmp_path / "a.ply")
    assert np.array_equal(read_mesh(tmp_path / "a.ply").colours, COLOURS)
    trimesh.Trimesh(VERTICES, TRIANGLES, process=False).export(tmp_path / "b.ply")
    assert read_mesh(tmp_path / "b.ply").colours is None


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("header", ["", "4 2\n"])
def test_plain_text_counts_from_0_or_1_with_or_without_a_header(tmp_path, first, header):
    lines = [" ".join(f"{v:.3f}" for v in vertex) for vertex in VERTICES]
    lines += [" ".join(str(v + first) for v in triangle) for triangle in TRIANGLES]
    (tmp_path / "a.txt").write_text("# a mesh\n" + header + "\n".join(lines) + "\n")
    assert np.array_equal(corners(read_mesh(tmp_path / "a.txt")), VERTICES[TRIANGLES])


def test_point_clouds_have_no_triangles(tmp_path):
    (tmp_path / "a.xyz").write_text("\n".join(f"{x:.2f},{y:.2f},{z:.2f},1,2,3" for x, y, z in VERTICES))
    found = read_mesh(tmp_path / "a.xyz")
    assert np.array_equal(found.vertices, VERTICES) and len(found.triangles) == 0 and found.colours[0].tolist() == [1, 2, 3]
    trimesh.PointCloud(VERTICES, colors=COLOURS).export(tmp_path / "b.ply")
    found = read_mesh(tmp_path / "b.ply")
    np.testing.assert_allclose(found.vertices, VERTICES, atol=1e-6)
    assert len(found.triangles) == 0
    cloud = laspy.create()
    cloud.header.scales, cloud.header.offsets = [0.001] * 3, [476000.0, 4204000.0, 0.0]
    cloud.x, cloud.y, cloud.z = VERTICES.T + np.array([[476000.0], [4204000.0], [0.0]])
    cloud.write(tmp_path / "c.laz")
    np.testing.assert_allclose(read_mesh(tmp_path / "c.laz").vertices, VERTICES + np.array([476000.0, 4204000.0, 0.0]), atol=1e-3)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.dxf", "0", "its name ends with '.dxf', known are .ply"),
        ("a.ply", "no mesh", "cannot be read as a mesh"),
        ("a.txt", "1 2 x", "cannot be read as a mesh"),
        ("a.txt", "", "cannot be read as a mesh"),
        ("a.txt", "0.0 0 0\n1.0 0 0\n1.0 1 0\n0 1 7\n", "cannot be read as a mesh"),
    ],
)
def test_files_that_are_no_mesh_are_a_sentence(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(WorkflowError, match=words):
        read_mesh(tmp_path / name)


def test_a_missing_file_is_a_sentence(tmp_path):
    with pytest.raises(WorkflowError, match="does not exist; correct its path"):
        read_mesh(tmp_path / "a.ply")
