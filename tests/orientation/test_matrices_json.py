"""Projection matrices in JSON: the same pixels as their own formula gives, and a sentence for every mistake."""

import json

import numpy as np
import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.interchange.matrices_json import read_matrices

K = [[1000.0, 0.0, 331.0], [0.0, 1001.0, 236.0], [0.0, 0.0, 1.0]]


def entry(centre=(1.0, 2.0, 9.0), angles=(3.0, 0.2, 0.1), **changes) -> dict:
    rotation = rotation_matrix(*angles)
    t = (-rotation @ np.array(centre)).tolist()
    return {"K": K, "R_world_to_camera": rotation.tolist(), "t": t, "width": 640, "height": 480, **changes}


def test_a_point_is_projected_as_k_r_t_say():
    given = entry()
    block = read_matrices(json.dumps({"photos/DSC_1.JPG": given}))
    view = View("DSC_1", block.cameras["DSC_1"], block.poses["DSC_1"].rotation, block.poses["DSC_1"].centre)
    rotation, t = np.array(given["R_world_to_camera"]), np.array(given["t"])
    point = rotation.T @ (np.array([0.2, -0.1, 5.0]) - t)
    image = np.array(K) @ [0.2, -0.1, 5.0]
    # Square pixels: the mean of the two focal lengths, half a pixel of 1000 apart.
    np.testing.assert_allclose(view.project(point[None])[0], image[:2] / image[2], atol=0.05)
    assert view.rotation[2] @ (point - view.centre) < 0


def test_a_centre_serves_as_well_as_a_translation_and_a_lens_is_read():
    given = {**entry(), "centre": [1.0, 2.0, 9.0], "k1": -0.1}
    del given["t"]
    block = read_matrices(json.dumps({"a.jpg": given}))
    np.testing.assert_allclose(block.poses["a"].centre, [1.0, 2.0, 9.0], atol=1e-9)
    assert block.cameras["a"].lens.k1 == -0.1


def test_the_object_lies_where_the_viewing_axes_meet():
    entries = {}
    for number, turn in enumerate(np.linspace(0, 2 * np.pi, 5, endpoint=False)):
        centre = np.array([5 * np.cos(turn), 5 * np.sin(turn), 3.0])
        ahead = -centre / np.linalg.norm(centre)
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.array([right, np.cross(ahead, right), ahead])
        entries[f"{number}.jpg"] = {**entry(), "R_world_to_camera": rotation.tolist(), "t": (-rotation @ centre).tolist()}
    points = read_matrices(json.dumps(entries)).points
    assert len(points) >= 10
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is no JSON"),
        ("[]", "must be an object"),
        (json.dumps({"a": 1}), "a in the file of matrices needs R_world_to_camera"),
        (json.dumps({"a": entry(K=[1, 2])}), "K of a in the file of matrices is not 3 x 3"),
        (json.dumps({"a": entry(width=0)}), "needs K .*, width and height"),
        (json.dumps({"a": entry(R_world_to_camera=np.diag([1.0, 1, -1]).tolist())}), "R of a .* is no rotation"),
        (json.dumps({"a": entry(K=[[1000, 0, 1], [0, 900, 1], [0, 0, 1]])}), "focal lengths of a, 1000.0 and 900.0 px, differ"),
    ],
)
def test_every_mistake_is_a_sentence(text, words):
    with pytest.raises(WorkflowError, match=words):
        read_matrices(text)
