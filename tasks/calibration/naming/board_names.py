"""Identification of the boards: which board of one photo is which of another. Boards are alike; only their places differ.

Strategy. The photo with the most boards gives a first map. A board has an origin and axes of its own, so that assigning one board
of a photo to one board of the map already fixes the projection, including its rotation; the nearest board that it predicts well is
added, the projection is fitted again, and so on outwards. Distortion and the error of extrapolation are thus absorbed step by step.
Every pair of a photo's board and a map's board is tried; the trial that names most boards wins, and among equals the one that fits
best. The assignment is one-to-one by construction, needs no principal axes (which are exchanged when they are nearly equally long),
cannot be rotated by 180 degrees or mirrored, and tolerates missing boards. Boards without a first corner (board_turns.py) are tried
in every order of their corners, and joined in the one that fits. Boards that the map lacks are added from photos that
name at least two others; then all photos are named again with the complete map.

`board_views.py` derives projections and places from boards, on a plane or anywhere in space.

The board of a photo that shows a single one cannot be identified, and need not be: all boards are equal, and its exterior
orientation is its own in any case.

Source: Kawka 2021, S2 and S4, where boards are matched by principal axes (sources/calibration.md).
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.naming.board_views import BoardViews, PlaneViews, imaged, on_map
from orthomill.tasks.geometry.rotation import nearest_rotation

NO_BOARDS = "No photograph shows a chessboard that could be used; check the number of inner corners."
# Generous, as the first prediction extrapolates a homography from one board through unknown distortion; boards do not overlap, so
# that a wrong one is hardly ever so near.
_NEAR = 0.4
"""Largest mean distance of a board's corners from their prediction, in sizes of the board in the photo."""
LOOSE, STRICT = 0.12, 0.02
"""The same after all boards of the photo were fitted together: with unknown distortion, and without any."""
_AMBIGUOUS = 2.0
"""A photo is ambiguous when another naming of as many boards fits at most so many times worse."""


@dataclass(frozen=True, eq=False)
class NamedPhoto:
    """`names` (B,): the number in the map of every board found, -1 for none; `turns` (B,): the order in which its corners are
    counted (board_turns.py). `projection` (3, 4) from the map to the photo (board_views.py), None when nothing could be named.
    `certain`: False when a single board was named, for it could be any."""

    names: np.ndarray
    turns: np.ndarray
    projection: np.ndarray | None
    certain: bool


@dataclass(frozen=True, eq=False)
class Naming:
    """`places` (K, 4, 4): rigid motions of the boards into the system of board 0, the most central one; photos in their order."""

    places: np.ndarray
    photos: tuple[NamedPhoto, ...]


def plane_views(found: list[np.ndarray], local: np.ndarray, orders: np.ndarray | None = None) -> list[BoardViews]:
    """found: per photo (B, N, 2) px from the image centre, y up, NaN for corners that are not known; local: (N, 2) m; orders:
    (T, N) of board_turns.py, by default the one in which the corners were found."""
    orders = np.arange(len(local))[None] if orders is None else orders
    return [PlaneViews(xy, local, orders) for xy in found]


def name_boards(views: list[BoardViews], local: np.ndarray, boards: int, fit: float = LOOSE) -> Naming:
    """Names the boards of all photos; local: (N, 2) m. `boards`: how many there are; 0: as many as the photos show. `fit`: LOOSE
    or STRICT.

    Raises GeometryError when no photo shows a board.
    """
    # Whole boards count: a cut board fixes the map less well. The photo's number makes the order unique, and with it the result.
    order = sorted(range(len(views)), key=lambda photo: (-int(np.isfinite(views[photo].xy).all(axis=(1, 2)).sum()), photo))
    if not order or not len(views[order[0]].xy):
        raise GeometryError(NO_BOARDS)
    places = _map_of(views[order[0]], local)
    for photo in order[1:]:
        places = _extended(places, _named(views[photo], places, local, fit), views[photo])
    photos = [_named(own, places, local, fit) for own in views]
    places, photos = _most_frequent(places, photos, boards)
    turned = [own.turned(photo.turns) for own, photo in zip(views, photos, strict=True)]
    return _averaged(places, photos, turned, local)


def _map_of(views: BoardViews, local: np.ndarray) -> np.ndarray:
    """The boards of one photo in the system of its most central one: (B, 4, 4), S2 to S6."""
    middles = np.nanmean(views.xy, axis=1)
    centre = int(np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin())
    order = np.argsort(np.linalg.norm(middles - middles[centre], axis=1), kind="stable")
    places = np.eye(4)[None]
    for number, board in enumerate(order[1:].tolist(), start=1):
        # Boards join from the middle outwards, so that the projection from those before hardly extrapolates.
        projection = views.projection(order[:number], on_map(places, local))
        places = views.together(order[: number + 1], np.append(places, views.place(projection, board)[None], axis=0))
    return places


def _named(views: BoardViews, places: np.ndarray, local: np.ndarray, fit: float) -> NamedPhoto:
    """The best of all trials; of an ambiguous photo only its most central board, which may be any."""
    xy = views.xy
    best, score, second = NamedPhoto(np.full(len(xy), -1), np.zeros(len(xy), int), None, False), (0, -np.inf), -np.inf
    points = on_map(places, local)
    size = np.array([np.linalg.norm(np.nanmax(board, axis=0) - np.nanmin(board, axis=0)) for board in xy])
    met: dict[bytes, _Grown] = {}
    for start in product(range(len(xy)), range(len(places)), range(len(views.orders))):
        names, turns, projection, misfit = _grown(start, views, points, size, met)
        trial = (int((names >= 0).sum()), -misfit)
        same = np.array_equal(names, best.names) and np.array_equal(turns, best.turns)
        if not misfit < fit or trial[0] < score[0] or same:
            continue
        if trial > score:
            # The former best is a rival only if it names as many boards.
            second = score[1] if trial[0] == score[0] else -np.inf
            best, score = NamedPhoto(names, turns, projection, trial[0] > 1 or len(places) == 1), trial
        else:
            second = max(second, trial[1])
    # Scores are negative misfits: the rival is ambiguous when its misfit is less than _AMBIGUOUS times the best one.
    ambiguous = score[0] > 1 and second > _AMBIGUOUS * score[1]
    return _most_central(best, xy) if ambiguous else best


def _most_central(photo: NamedPhoto, xy: np.ndarray) -> NamedPhoto:
    """The photo with a single name: two boards whose relative place is nearly the same after exchanging them can be named in two
    ways, and a homography absorbs the difference."""
    named = np.flatnonzero(photo.names >= 0)
    board = named[np.linalg.norm(np.nanmean(xy[named], axis=1), axis=1).argmin()]
    return replace(photo, names=np.where(np.arange(len(xy)) == board, photo.names, -1), certain=False)


_Grown = tuple[np.ndarray, np.ndarray, np.ndarray, float]
"""Names (B,), turns (B,), projection and mean misfit (in sizes of a board)."""


def _grown(
    start: tuple[int, int, int], views: BoardViews, points: np.ndarray, size: np.ndarray, met: dict[bytes, _Grown]
) -> _Grown:
    """What follows from one pair of photo board and map board, and the order of its corners; `met`: what followed from the names
    and turns that other starts went through, at which this one may arrive in another order."""
    names, turns = np.full(len(views.xy), -1), np.zeros(len(views.xy), int)
    names[start[0]], turns[start[0]] = start[1:]
    passed: list[bytes] = []
    while (state := names.tobytes() + turns.tobytes()) not in met:
        passed.append(state)
        known = np.flatnonzero(names >= 0)
        projection = views.turned(turns).projection(known, points[names[known]])
        seen = imaged(projection, points)
        each = np.array([_misfits(views.xy[:, order], seen) for order in views.orders]) / size[:, None]
        own = each[turns[known], known, names[known]]
        turn, off = each.argmin(axis=0), each.min(axis=0)
        # A board has one name and a name one board: rows and columns that are taken are out of the search.
        off[known], off[:, names[known]] = np.inf, np.inf
        board, name = np.unravel_index(off.argmin(), off.shape)
        if off[board, name] > _NEAR:
            met[state] = names, turns, projection, float(own.mean())
            break
        names[board], turns[board] = name, turn[board, name]
    met |= dict.fromkeys(passed, met[state])
    return met[state]


def _misfits(xy: np.ndarray, computed: np.ndarray) -> np.ndarray:
    """(B, K) px: mean distance of the known corners of each board (B, N, 2) from those computed for each board (K, N, 2) of the
    map; infinite where one lies behind the camera."""
    off = np.linalg.norm(xy[:, None] - computed[None], axis=3)
    known = np.isfinite(xy).all(axis=-1)[:, None]
    total = np.where(known, np.nan_to_num(off, nan=np.inf), 0.0).sum(axis=2)
    return total / known.sum(axis=2)


def _extended(places: np.ndarray, named: NamedPhoto, views: BoardViews) -> np.ndarray:
    """The map with the boards that a photo shows in addition to two or more known ones."""
    # A single known board leaves its identity open, and with it the place of every board next to it.
    if named.projection is None or (named.names >= 0).sum() < 2:
        return places
    projection, own = named.projection, views.turned(named.turns)
    unknown = np.flatnonzero(named.names < 0).tolist()
    return np.concatenate([places, *(own.place(projection, board)[None] for board in unknown)])


def _most_frequent(places: np.ndarray, photos: list[NamedPhoto], boards: int) -> tuple[np.ndarray, list[NamedPhoto]]:
    """Only the `boards` that most photos show (anything else is a false detection), the most central one first."""
    # A photo with a single name could show any board: it says nothing about any but the first.
    certain = [photo for photo in photos if photo.certain]
    times = np.array([sum(name in photo.names for photo in certain or photos) for name in range(len(places))])
    kept = np.argsort(-times, kind="stable")[: (boards or len(places)) if certain else 1]
    kept = kept[times[kept] > 0]
    middle = places[kept, :3, 3].mean(axis=0)
    order = kept[np.argsort(np.linalg.norm(places[kept, :3, 3] - middle, axis=1), kind="stable")]
    # One element more than boards: names[-1] = -1 keeps boards without a name without one.
    number = np.full(len(places) + 1, -1)
    number[order] = np.arange(len(order))
    return places[order], [_renumbered(photo, number) for photo in photos]


def _renumbered(photo: NamedPhoto, number: np.ndarray) -> NamedPhoto:
    """The photo with new numbers; a single board becomes board 0, as all boards are equal."""
    names = number[photo.names]
    if not photo.certain:
        names = np.where(photo.names >= 0, 0, -1)
    return replace(photo, names=names)


def _averaged(places: np.ndarray, photos: list[NamedPhoto], views: list[BoardViews], local: np.ndarray) -> Naming:
    """The places of the boards as the median over the photos that show board 0, each refined by itself (S6), and the projections
    of all photos in the system of board 0."""
    start = np.linalg.inv(places[0]) @ places
    observed: list[list[np.ndarray]] = [[] for _ in places]
    for photo, own in zip(photos, views, strict=True):
        shown = np.flatnonzero(photo.names >= 0)
        shown = shown[np.argsort(photo.names[shown], kind="stable")]
        # Places of different photos can only be averaged in one system, which is that of board 0.
        if len(shown) > 1 and photo.names[shown[0]] == 0:
            refined = own.together(shown, start[photo.names[shown]])
            for name, place in zip(photo.names[shown], refined, strict=True):
                observed[name].append(place)
    averaged = np.array([_median(np.array(own)) if own else start[name] for name, own in enumerate(observed)])
    points = on_map(averaged, local)
    return Naming(averaged, tuple(_with_projection(photo, own, points) for photo, own in zip(photos, views, strict=True)))


def _median(places: np.ndarray) -> np.ndarray:
    """(4, 4) of places (n, 4, 4): the median shift, and the rotation nearest to the median of their matrices."""
    middle = np.median(places, axis=0)
    middle[:3, :3] = nearest_rotation(middle[:3, :3])
    return middle


def _with_projection(photo: NamedPhoto, views: BoardViews, points: np.ndarray) -> NamedPhoto:
    known = np.flatnonzero(photo.names >= 0)
    return replace(photo, projection=views.projection(known, points[photo.names[known]]) if len(known) else None)
