"""Names of boards under permutation, rotation of the camera and missing boards; both kinds of board views agree on a plane."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.calibration.naming.board_names import STRICT, NamedPhoto, Naming, _most_frequent, name_boards, plane_views
from orthomill.tasks.calibration.naming.board_views import PlaneViews, SpaceViews, imaged, in_plane, motion_in_plane, on_map
from orthomill.tasks.geometry.rotation import rotation_matrix

LOCAL = np.array([[0.04 * i, 0.04 * j] for j in range(3) for i in range(4)])
MOTIONS = np.array([[0.2, 0.0, 0.0], [1.5, 0.35, 0.05], [-2.0, -0.3, 0.1], [2.9, 0.05, 0.34], [-0.6, -0.05, -0.33]])
PLACES = np.array([in_plane(motion) for motion in MOTIONS])
C = 2000.0


def camera(omega: float, phi: float, kappa: float) -> np.ndarray:
    """(3, 4) of a camera 1.6 m above the plane."""
    R = rotation_matrix(omega, phi, kappa)
    return np.diag([-C, -C, 1.0]) @ np.column_stack([R, -R @ (1.6 * R[2])])


def photographed(omega: float, phi: float, kappa: float, order: list[int]) -> np.ndarray:
    """(B, 12, 2) px: the boards of `order` as one photo shows them."""
    return imaged(camera(omega, phi, kappa), on_map(PLACES[order], LOCAL))


def three_photos(orders: list[list[int]]) -> list[np.ndarray]:
    """Three photos, tilted and turned differently, with their boards in these orders."""
    poses = ((0.3, 0.1, 0.0), (-0.2, 0.3, 2.0), (0.1, -0.4, -1.0))
    return [photographed(*pose, order) for pose, order in zip(poses, orders, strict=True)]


def one_to_one(naming: Naming, orders: list[list[int]]) -> bool:
    """Whether the names are one renumbering of the true boards, the same in all photos."""
    pairs = {(int(n), t) for own, order in zip(naming.photos, orders, strict=True) for n, t in zip(own.names, order, strict=True)}
    return min(n for n, _ in pairs) >= 0 and len(pairs) == len({n for n, _ in pairs}) == len({t for _, t in pairs})


@settings(deadline=None, max_examples=15)
@given(
    orders=st.lists(st.permutations(range(5)), min_size=3, max_size=3),
    kappas=st.lists(st.floats(-np.pi, np.pi), min_size=3, max_size=3),
)
def test_names_do_not_depend_on_the_order_of_the_boards_or_the_rotation_of_the_camera(orders, kappas):
    tilts = [(0.3, 0.1), (-0.2, 0.3), (0.1, -0.4)]
    found = [photographed(*tilt, kappa, order) for tilt, kappa, order in zip(tilts, kappas, orders, strict=True)]
    naming = name_boards(plane_views(found, LOCAL), LOCAL, 5, STRICT)
    assert one_to_one(naming, orders) and all(photo.certain for photo in naming.photos)


@settings(deadline=None, max_examples=15)
@given(shown=st.sets(st.integers(0, 4), min_size=2, max_size=4), order=st.permutations(range(5)))
def test_a_photo_that_lacks_boards_names_the_others(shown, order):
    orders = [list(range(5)), [board for board in order if board in shown], [4, 3, 2, 1, 0]]
    found = [
        photographed(0.3, 0.1, 0.0, orders[0]),
        photographed(-0.2, 0.3, 2.0, orders[1]),
        photographed(0.1, -0.4, -1.0, orders[2]),
    ]
    naming = name_boards(plane_views(found, LOCAL), LOCAL, 0)
    named = [photo for photo in range(3) if naming.photos[photo].certain]
    assert {0, 2} <= set(named)
    assert one_to_one(Naming(naming.places, tuple(naming.photos[p] for p in named)), [orders[p] for p in named])


def test_a_board_that_only_a_later_photo_shows_is_added_to_the_map():
    orders = [[0, 1, 2, 3], [4, 2, 1], [3, 4, 0]]
    found = [
        photographed(0.3, 0.1, 0.0, orders[0]),
        photographed(-0.2, 0.3, 2.0, orders[1]),
        photographed(0.1, -0.4, -1.0, orders[2]),
    ]
    naming = name_boards(plane_views(found, LOCAL), LOCAL, 0)
    assert len(naming.places) == 5 and one_to_one(naming, orders)


def test_the_places_of_the_boards_are_the_true_ones_relative_to_the_first():
    orders = [[0, 1, 2, 3, 4]] * 3
    found = [
        photographed(0.3, 0.1, 0.0, orders[0]),
        photographed(-0.2, 0.3, 2.0, orders[1]),
        photographed(0.1, -0.4, -1.0, orders[2]),
    ]
    naming = name_boards(plane_views(found, LOCAL), LOCAL, 5)
    true = [orders[0][naming.photos[0].names.tolist().index(name)] for name in range(5)]
    expected = np.linalg.inv(PLACES[true[0]]) @ PLACES[true]
    assert true[0] == 0, "the most central board"
    assert naming.places == pytest.approx(expected, abs=1e-6)


def test_the_boards_that_most_photos_show_are_kept():
    photos = [NamedPhoto(np.array(names), np.zeros(3, int), None, True) for names in ([0, 1, 2], [2, 0, 1], [2, 0, 3])]
    places = np.array([in_plane(np.array([0.0, x, 0.0])) for x in (0.0, 1.0, 3.0, 9.0)])
    kept, named = _most_frequent(places, photos, 3)
    assert kept[:, 0, 3].tolist() == [1.0, 0.0, 3.0], "the most central one first"
    assert [photo.names.tolist() for photo in named] == [[1, 0, 2], [2, 1, 0], [2, 1, -1]]
    alone = _most_frequent(places, [NamedPhoto(np.array([3]), np.zeros(1, int), None, False)], 0)
    assert alone[1][0].names.tolist() == [0] and len(alone[0]) == 1


@settings(deadline=None, max_examples=20)
@given(angle=st.floats(-3.1, 3.1), x=st.floats(-2, 2), y=st.floats(-2, 2))
def test_places_in_the_plane_are_rigid_motions(angle, x, y):
    place = in_plane(np.array([angle, x, y]))
    assert place[:3, :3] @ place[:3, :3].T == pytest.approx(np.eye(3)) and place[:3, 3].tolist() == [x, y, 0.0]
    assert motion_in_plane(place) == pytest.approx([angle, x, y], abs=1e-12)


def test_points_behind_the_camera_have_no_image():
    P = camera(0.0, 0.0, 0.0)
    xy = imaged(P, np.array([[0.1, 0.2, 0.0], [0.1, 0.2, 1.7]]))
    assert xy[0] == pytest.approx([0.1 * C / 1.6, 0.2 * C / 1.6]) and np.isnan(xy[1]).all()


def both_kinds() -> tuple[PlaneViews, SpaceViews]:
    """All boards of one photo on the plane, by homographies and by poses."""
    R = rotation_matrix(0.3, 0.1, 0.5)
    exterior = np.vstack([np.column_stack([R, -R @ (1.6 * R[2])]), [0.0, 0.0, 0.0, 1.0]])
    xy = photographed(0.3, 0.1, 0.5, list(range(5)))
    orders = np.arange(12)[None]
    return PlaneViews(xy, LOCAL, orders), SpaceViews(xy, LOCAL, exterior @ PLACES, C, orders)


def test_both_kinds_of_views_image_the_map_alike():
    plane, space = both_kinds()
    known, points = np.array([1, 3]), on_map(PLACES[[1, 3]], LOCAL)
    for views in (plane, space):
        projection = views.projection(known, points)
        assert imaged(projection, on_map(PLACES, LOCAL)) == pytest.approx(plane.xy, abs=1e-5)
        assert views.place(projection, 4) == pytest.approx(PLACES[4], abs=1e-8)


def test_both_kinds_of_views_give_the_same_places_relative_to_the_first():
    plane, space = both_kinds()
    boards, near = np.array([2, 0, 4]), PLACES[[2, 0, 4]] @ in_plane(np.array([0.01, 0.003, -0.002]))
    expected = np.linalg.inv(PLACES[2]) @ PLACES[[2, 0, 4]]
    assert plane.together(boards, near) == pytest.approx(expected, abs=1e-5)
    assert space.together(boards, near) == pytest.approx(expected, abs=1e-9)


def test_unknown_corners_do_not_change_the_place_of_a_board():
    plane, _ = both_kinds()
    plane.xy[4, :5] = np.nan
    projection = plane.projection(np.array([0, 1]), on_map(PLACES[[0, 1]], LOCAL))
    assert plane.place(projection, 4) == pytest.approx(PLACES[4], abs=1e-8)
