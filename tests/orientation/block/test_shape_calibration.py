"""A nominal camera constant without control: determined by photographs that converge, kept by those that look one way."""

import numpy as np
import pytest
from orienting import orient, sentences, standardised_lengths
from simulated_block import DRONE, block_of, looking

from orthomill.tasks.geometry.view import View

NOMINAL = DRONE.changed(c=1.04 * DRONE.c, k1=0.0)


def around(rng, aim, spread, height, photos=8):
    """Photographs from a ring; `aim` between 0, all to the middle, and 1, all down; points within `spread` m of the middle
    and 7 m of relief."""
    views = []
    for i, turn in enumerate(np.linspace(0, 2 * np.pi, photos, endpoint=False)):
        centre = np.array([20 * np.cos(turn), 20 * np.sin(turn), height + rng.normal(0, 1)])
        inward = aim * np.array([0.0, 1e-3, -1.0]) + (1 - aim) * -centre / np.linalg.norm(centre)
        views.append(View(f"r{i:02d}", DRONE, looking(inward), centre))
    points = np.column_stack([rng.uniform(-spread, spread, (400, 2)), rng.uniform(-1, 6, 400)])
    return block_of(views, points, rng, gnss=None, camera=NOMINAL)


@pytest.mark.slow
def test_photographs_that_converge_determine_the_camera_constant():
    block = around(np.random.default_rng(3), aim=0.0, spread=8, height=12)
    out = orient(block)
    result, camera = out["block"], out["block"].cameras["cam"]
    assert len(result.photos) == 8 and not any("nominal" in text for text in sentences(out["precision"]))
    assert abs(result.sigma0_px / 0.3 - 1) < 0.05
    assert abs(camera.c - DRONE.c) < 4 * np.sqrt(camera.covariance[0][0]) < 0.005 * DRONE.c
    truth, found = (np.array(rows) for rows in ([v.centre for v in block.views], [result.of(v.name).centre for v in block.views]))
    scale = np.linalg.norm(truth - truth.mean(axis=0)) / np.linalg.norm(found - found.mean(axis=0))
    assert np.abs(standardised_lengths(block, result, scale)).max() < 4.5


def test_photographs_that_look_one_way_keep_it_and_report_it():
    block = around(np.random.default_rng(4), aim=0.97, spread=30, height=30)
    out = orient(block)
    assert out["block"].cameras["cam"].c == NOMINAL.c
    assert any("nominal" in text for text in sentences(out["precision"]))
