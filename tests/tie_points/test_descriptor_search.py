"""What is found about epipolar lines is what the search among all finds there."""

import cv2
import numpy as np
import pytest

from orthomill.schemas.camera import Camera, Cameras
from orthomill.tasks.tie_points.descriptor_search import matches_along_lines, mutual_matches
from orthomill.tasks.tie_points.features import SEARCHED, searched_parts
from orthomill.tasks.tie_points.match_records import Features, Values
from orthomill.tasks.tie_points.pair_matching import PairRules, epipolar_matrix, match_pair

CAMERA = Camera(name="c", width=2000, height=1500, c=1800.0, source="given")
CAMERAS = Cameras(cameras={"c": CAMERA}, of_photo={"a": "c", "b": "c"})
MOTIONS = {"sideways": (1.0, 0.1, 0.0), "forward": (0.05, 0.02, 1.0), "oblique": (0.6, -0.5, 0.5)}


def scene(motion: tuple[float, float, float], shared: int, alone: int, seed: int = 3):
    """Places (N, 2) and descriptors (N, 128) of two photographs turned by 5 degrees, the shared ones first in another order; and
    the essential matrix for places in px from the principal point, y up."""
    rng = np.random.default_rng(seed)
    rotation = cv2.Rodrigues(np.radians([2.0, -3.0, 5.0]))[0]
    points = np.column_stack([rng.uniform(-4, 4, shared), rng.uniform(-3, 3, shared), rng.uniform(-9, -5, shared)])
    moved = (points - 0.7 * np.array(motion)) @ rotation.T
    own = [CAMERA.c * part[:, :2] / -part[:, 2:] for part in (points, moved)]
    places = [np.vstack([part, rng.uniform(-900, 900, (alone, 2))]) for part in own]
    same = rng.gamma(0.6, 40.0, (shared, 128))
    descriptors = [np.vstack([same + rng.normal(0, 5, same.shape), rng.gamma(0.6, 40.0, (alone, 128))]) for _ in "ab"]
    descriptors = [part.clip(0, 255).astype(np.uint8) for part in descriptors]
    order = rng.permutation(shared + alone)
    places[1], descriptors[1] = places[1][order], descriptors[1][order]
    base = rotation @ (0.7 * np.array(motion))
    cross = np.array([[0, -base[2], base[1]], [base[2], 0, -base[0]], [-base[1], base[0], 0]])
    into = np.diag([1 / CAMERA.c, 1 / CAMERA.c, -1.0])
    return places, descriptors, into @ cross @ rotation @ into, order


def distances(matrix: np.ndarray, places: list[np.ndarray], pairs: np.ndarray) -> np.ndarray:
    ones = np.ones((len(pairs), 1))
    lines = np.hstack([places[0][pairs[:, 0]], ones]) @ matrix.T
    return np.abs((lines * np.hstack([places[1][pairs[:, 1]], ones])).sum(axis=1)) / np.hypot(lines[:, 0], lines[:, 1])


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_search_along_lines_finds_the_matches_near_them(motion):
    places, descriptors, matrix, _ = scene(MOTIONS[motion], 600, 900)
    everywhere = mutual_matches(*descriptors, 0.8)
    along = matches_along_lines(tuple(descriptors), tuple(places), matrix, 5.0, 0.8)
    near = everywhere[distances(matrix, places, everywhere) < 5.0]
    assert len(near) > 550
    assert set(map(tuple, near.tolist())) <= set(map(tuple, along.tolist())) <= set(map(tuple, everywhere.tolist()))
    assert np.all(np.diff(along[:, 0]) > 0)


def test_a_repeated_point_elsewhere_still_makes_a_match_ambiguous():
    """Its double lies far from the line; the search among all refuses the match, and so must this one."""
    places, descriptors, matrix, order = scene(MOTIONS["sideways"], 300, 2500)
    at = int(np.flatnonzero(order == 0)[0])
    double = int(np.flatnonzero(order == 350)[0])
    descriptors[1][double] = descriptors[1][at]
    places[1][double] = places[1][at] + [0.0, 400.0]
    assert 0 not in matches_along_lines(tuple(descriptors), tuple(places), matrix, 5.0, 0.8)[:, 0]


def test_nothing_to_compare_gives_no_matches():
    none = np.empty((0, 128), np.uint8), np.empty((0, 2))
    _, _, matrix, _ = scene(MOTIONS["sideways"], 20, 0)
    assert matches_along_lines((none[0],) * 2, (none[1],) * 2, matrix, 5.0, 0.8).shape == (0, 2)


def photograph(places: np.ndarray, descriptors: np.ndarray, size: np.ndarray) -> tuple[Features, Values]:
    zero = np.zeros(len(places), np.float32)
    col, row = places[:, 0] + (CAMERA.width - 1) / 2, (CAMERA.height - 1) / 2 - places[:, 1]
    return Features(col, row, size.astype(np.float32), zero, zero), Values(descriptors.ravel())


def test_small_features_are_matched_where_the_largest_determine_the_lines():
    """5000 features each; of the 1200 shared ones 200 are large. Nearly all are found, and no others."""
    places, descriptors, _, order = scene(MOTIONS["oblique"], 1200, 3800)
    size = np.where(np.arange(5000) < 200, 12.0, 3.0)
    sides = photograph(places[0], descriptors[0], size), photograph(places[1], descriptors[1], size[order])
    found = match_pair(*sides, CAMERAS, ("a", "b"), PairRules(0.8, 1.5))
    matches = found.matches
    assert found.summary.accepted and len(matches) > 1150
    assert (order[matches.right] == matches.left).mean() > 0.99


def test_photographs_with_different_largest_features_are_compared_completely():
    places, descriptors, _, order = scene(MOTIONS["sideways"], 600, 4400)
    size = np.where(np.arange(5000) < 600, 3.0, 12.0)
    sides = photograph(places[0], descriptors[0], size), photograph(places[1], descriptors[1], size[order])
    matches = match_pair(*sides, CAMERAS, ("a", "b"), PairRules(0.8, 1.5)).matches
    assert len(matches) > 550 and (order[matches.right] == matches.left).mean() > 0.99


def test_points_for_which_magsac_fails_get_their_geometry(monkeypatch):
    """OpenCV's MAGSAC fails an assertion for a few sets of good points; that must not end a run."""
    places, _, _, order = scene(MOTIONS["oblique"], 200, 0)
    points = places[0], places[1][np.argsort(order)]
    real = cv2.findFundamentalMat

    def stumbling(left, right, method, *more):
        if method == cv2.USAC_MAGSAC:
            raise cv2.error("!model.empty()")
        return real(left, right, method, *more)

    monkeypatch.setattr(cv2, "findFundamentalMat", stumbling)
    nominal = CAMERA.model_copy(update={"source": "exif"})
    matrix = epipolar_matrix(points, (nominal, nominal), 1.5)
    assert np.median(distances(matrix, list(points), np.column_stack([np.arange(200)] * 2))) < 0.01


@pytest.mark.parametrize("shape", [(1125, 2000), (2000, 1333), (1500, 1500), (300, 2000), (130, 90)])
def test_searched_parts_are_nearly_equal(shape):
    parts = [cell.window for cell in searched_parts(shape)]
    assert sum(part.height * part.width for part in parts) == shape[0] * shape[1]
    assert all(part.row % 16 == 0 and part.col % 16 == 0 for part in parts)
    for sides in ([part.height for part in parts], [part.width for part in parts]):
        assert max(sides) <= 1.5 * SEARCHED + 16 and min(sides) > max(sides) - 16 * len(parts)
