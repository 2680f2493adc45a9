"""A model of vertical photographs in a system of its own, and what is known of them in that of the ground."""

import numpy as np

from orthomill.tasks.adjustment.model.network import State
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.start.georeference import Known

SITE = np.array([407000.0, 4357000.0, 0.0])
TURN, SCALE = rotation_matrix(0.4, -0.7, 2.0), 0.013
NOTHING = np.full((6, 3), np.nan)
GRID = np.array([[0, 0, 100], [60, 0, 102], [120, 0, 99], [0, 80, 101], [60, 80, 100], [120, 80, 103.0]])
GROUND = np.array([[10, 10, 2], [110, 15, 5], [100, 75, -3], [5, 70, 1], [55, 40, 0.0]])


def in_model(points):
    """Ground points less SITE in the system of the model."""
    return SCALE * points @ TURN.T


def block(centres=GRID, control=GROUND[:0], tilt=0.02):
    """A model of vertical photographs, and what is known of them: exact positions and control."""
    rng = np.random.default_rng(3)
    rotation = np.array([rotation_matrix(*rng.normal(0, tilt, 2), k) @ TURN.T for k in rng.uniform(-3, 3, len(centres))])
    model = State(rotation, in_model(centres), in_model(GROUND), np.zeros((1, 8)), np.zeros(3))
    count = len(centres)
    known = Known(
        centres + SITE,
        np.full((count, 3), 0.3),
        control + SITE,
        np.full((len(control), 3), 0.02),
        in_model(control),
        np.full((count, 3), np.nan),
        np.tile([0.0, 1.0, 0.0], (count, 1)),
    )
    return model, known
