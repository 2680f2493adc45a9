"""The centre of a leaning circle's ellipse beside the image of its centre, by projecting the circle."""

import cv2
import numpy as np
import pytest

from orthomill.tasks.targets.leaning_circle import eccentricity


@pytest.mark.parametrize(("radius", "lean", "c"), [(9.0, 45.0, 600.0), (40.0, 30.0, 1500.0), (20.0, 60.0, 400.0)])
def test_eccentricity_is_that_of_a_projected_circle(radius, lean, c):
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    tilt = np.radians(lean)
    x, along = np.cos(angle), np.sin(angle)
    distance = c / radius
    depth = distance + along * np.sin(tilt)
    image = c * np.column_stack([x, along * np.cos(tilt)]) / depth[:, None]
    (col, row), axes, _ = cv2.fitEllipseDirect(image.astype(np.float32)[:, None])
    short, long = sorted(axis / 2 for axis in axes)
    assert abs(col) < 1e-2
    assert abs(row) == pytest.approx(eccentricity(long, short, c), rel=0.05)


def test_a_circle_that_faces_the_camera_has_none():
    assert eccentricity(8.0, 8.0, 600.0) == 0.0
