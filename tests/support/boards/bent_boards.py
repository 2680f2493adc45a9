"""Photographs of one board that is bent to a circular arc, with known truth."""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.boards.board_network import BoardCorners, BoardState
from orthomill.tasks.adjustment.boards.board_projection import projected
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.rotation import rotation_matrix

INTERIOR = np.array([900.0, 4.0, -3.0, -0.1, 0.05, *[0.0] * 12])
PHOTOS, NOISE = 20, 0.2


def bent_photographs(target: CalibrationTarget, sag: float, seed: int) -> tuple[BoardState, BoardCorners]:
    """The true state with a flat board, as an adjustment starts from it, and the corners of the bent one: its rows are arcs of a
    circle whose middle stands `sag` m above their ends."""
    generator = np.random.default_rng(seed)
    flat = np.column_stack([target.local, np.zeros(len(target.local))])
    board = arc(target.local, sag)
    poses = [_pose(board.mean(axis=0), generator) for _ in range(PHOTOS)]
    rotation, centre = (np.array(part) for part in zip(*poses, strict=True))
    true = BoardState(rotation, centre, np.eye(3)[None], np.zeros((1, 3)), board[None], INTERIOR)
    corner, photo = np.divmod(np.arange(len(board) * PHOTOS), PHOTOS)
    corners = BoardCorners(photo, np.zeros_like(photo), corner, np.zeros((len(photo), 2)))
    xy = projected(true, corners) + generator.normal(0.0, NOISE, (len(photo), 2))
    inside = (np.abs(xy) < np.array(target.size) / 2).all(axis=1)
    return replace(true, local=flat[None]), replace(corners, xy=xy).take(inside)


def arc(local: np.ndarray, sag: float) -> np.ndarray:
    """(N, 3) m: the corners (N, 2) on a sheet whose rows are bent to an arc, without being stretched."""
    middle = local.mean(axis=0)
    along, half = local[:, 0] - middle[0], np.ptp(local[:, 0]) / 2.0
    if not sag:
        return np.column_stack([local, np.zeros(len(local))])
    radius = half**2 / (2.0 * sag)
    for _ in range(30):  # half the row is an arc of the radius: sag = radius (1 - cos(half / radius))
        radius = half / np.arccos(1.0 - sag / radius)
    height = radius * np.cos(along / radius) - radius
    return np.column_stack([middle[0] + radius * np.sin(along / radius), local[:, 1], height - height.mean()])


def _pose(middle: np.ndarray, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    side, tilt = 2 * np.pi * generator.uniform(), generator.uniform(0.1, 0.5)
    rotation = rotation_matrix(tilt * np.cos(side), tilt * np.sin(side), generator.uniform(-3, 3))
    aim = middle * [1, 1, 0] + generator.normal(0, 0.02, 3) * [1, 1, 0]
    return rotation, aim + generator.uniform(0.35, 0.6) * rotation[2]
