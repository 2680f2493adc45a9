"""Photographs of boards with known truth: places, corners, starting values, and the network that adjusts them."""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardNetwork, BoardState
from orthomill.tasks.adjustment.boards.board_projection import projected
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

LOCAL = np.array([[0.05 * i, 0.05 * j, 0.0] for j in range(4) for i in range(5)])
INTERIOR = np.array([900.0, 4.0, -3.0, -0.1, 0.05, -0.02, 0.001, -0.0008, 0.002, -0.001, *[0.0] * 7])
FREE = ("c", "x0", "y0", "k1", "k2")


def truth(photos: int = 8, boards: int = 3, height: float = 0.0) -> BoardState:
    """Photos tilted in all directions and turned; boards next to each other, rotated, at different heights if asked."""
    rotation, centre = [], []
    for photo in range(photos):
        side = 2 * np.pi * photo / photos
        R = rotation_matrix(0.5 * np.cos(side), 0.5 * np.sin(side), photo * np.pi / 2)
        rotation.append(R)
        centre.append(np.array([0.35, 0.1, 0.0]) + 0.9 * R[2])
    turn = np.array([rotation_of_vector(np.array([0.3 * height, 0.2 * height, 0.7]) * board) for board in range(boards)])
    shift = np.array([[0.32 * board, 0.02 * board, height * board] for board in range(boards)])
    return BoardState(np.array(rotation), np.array(centre), turn, shift, np.tile(LOCAL, (boards, 1, 1)), INTERIOR)


def all_corners(state: BoardState, noise: float = 0.0, seed: int = 0) -> BoardCorners:
    boards, count = state.local.shape[:2]
    numbers = np.arange(boards), np.arange(count), np.arange(len(state.rotation))
    board, corner, photo = (part.ravel() for part in np.meshgrid(*numbers, indexing="ij"))
    empty = BoardCorners(photo, board, corner, np.zeros((len(photo), 2)))
    xy = (
        projected(state, empty) + np.random.default_rng(seed).normal(0.0, noise, (len(photo), 2))
        if noise
        else projected(state, empty)
    )
    return replace(empty, xy=xy)


def network(state: BoardState, free=FREE, arrangement="plane", **rest) -> BoardNetwork:
    return BoardNetwork(len(state.rotation), len(state.turn), free, arrangement, LOCAL, **rest)


def disturbed(state: BoardState, free=FREE) -> BoardState:
    """Starting values as a homography gives them: 5 % wrong c, no distortion, poses and boards off by some per cent."""
    generator = np.random.default_rng(3)
    start = state.with_interior(c=1.05 * state.interior[0], **dict.fromkeys(free[1:], 0.0))
    turned = np.array([rotation_of_vector(generator.normal(0, 0.02, 3)) @ R for R in state.rotation])
    moved = state.shift + np.vstack([np.zeros(3), generator.normal(0, 0.01, (len(state.shift) - 1, 3)) * [1, 1, 0]])
    return replace(start, rotation=turned, centre=state.centre + generator.normal(0, 0.02, state.centre.shape), shift=moved)


def plain(state: BoardState, free=FREE) -> BoardState:
    """Only the free parameters differ from zero, so that the model can be right."""
    return state.with_interior(**{name: 0.0 for name in PARAMETERS[1:] if name not in free})
