"""How far apart photographs were taken."""

import numpy as np

from orthomill.schemas.photo import Photos


def median_base(photos: Photos) -> float | None:
    """Median distance (m) of a photograph to the nearest other one, by their positions; None of fewer than two positions."""
    centres = np.array([photo.position for photo in photos.photos if photo.position is not None])
    if len(centres) < 2:
        return None
    # The smallest distance is that of a centre to itself.
    nearest = [np.sort(np.linalg.norm(centres - centre, axis=1))[1] for centre in centres]
    return round(float(np.median(nearest)), 2)
