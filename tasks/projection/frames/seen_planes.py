"""From which side photographs see the plane of an output."""

from collections.abc import Sequence

import numpy as np

from orthomill.schemas.solid.frames import AnyFrame, FlatFrame, Vector


def degrees_before(frame: AnyFrame, centres: Sequence[Vector]) -> float:
    """By how many degrees projection centres stand before the plane of an output at most, seen from its middle and corners;
    90 for what is no plane."""
    if not isinstance(frame, FlatFrame):
        return 90.0
    corner, right, up, normal = (np.array(values) for values in (frame.corner, frame.right, frame.up, frame.normal))
    width, height = frame.cols * frame.pixel, frame.rows * frame.pixel
    shares = np.array([(0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)])
    places = corner + shares[:, :1] * width * right - shares[:, 1:] * height * up
    along = np.array(centres)[:, None] - places
    distance = np.linalg.norm(along, axis=2)
    return float(np.degrees(np.arcsin(np.clip((along @ normal) / np.maximum(distance, 1e-12), -1.0, 1.0))).max())
