"""Lines of sections through a solid surface."""

import json

import numpy as np
import pytest

from orthomill.tasks.projection.lines.section_line import SectionLine, draw_section
from orthomill.tasks.projection.mesh.depth_rasters import cut_into_blocks
from orthomill.tasks.projection.mesh.mesh_mending import mend_mesh
from tests.support.solid import wall_and_box as scene


def test_a_section_line_is_the_outline_of_the_box_and_a_line_on_the_wall():
    mended = mend_mesh(scene.mesh(), "m", (100.0, 200.0, 0.0))
    raster = cut_into_blocks(mended.vertices, mended.triangles).corners
    line = SectionLine(name="plan", point=(0.0, 0.0, 1.03), normal=(0.0, 0.0, 2.0))
    drawn = draw_section(iter([raster]), mended.census, line)
    lines = [np.array(one) for one in json.loads(drawn.geojson.text)["features"][0]["geometry"]["coordinates"]]
    assert len(lines) == 2
    wall, box = sorted(lines, key=lambda one: len(one), reverse=True)
    assert np.allclose(np.vstack(lines)[:, 2], 1.03, atol=1e-5)
    length = np.linalg.norm(np.diff(wall, axis=0), axis=1).sum()
    outline = np.linalg.norm(np.diff(box, axis=0), axis=1).sum()
    assert length == pytest.approx(4.0, abs=1e-4) and outline == pytest.approx(2.0, abs=1e-4)
    assert np.array_equal(box[0], box[-1]) and np.allclose(wall[:, 1], 200.0, atol=1e-5)
    assert drawn.dxf.text.count("POLYLINE") == 2 and drawn.dxf.text.rstrip().endswith("EOF")


def test_a_section_line_needs_a_direction():
    with pytest.raises(ValueError, match="direction across the plane"):
        SectionLine(point=(0, 0, 0), normal=(0, 0, 0))
