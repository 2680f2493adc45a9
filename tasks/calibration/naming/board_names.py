"""Which board of one photo is which board of another: boards look alike, only their places tell them apart.

Strategy. The photo with the most boards gives a first map of them. A board has an origin and axes of its own, so that one board of
a photo taken for one board of the map already fixes the view, turn and all; the nearest board that it predicts well is added, the
view is fitted again, and so on outwards. Distortion and the error of the extrapolation are thus taken up as they grow. Every pair
of a photo's board and a map's board is tried; the trial that names most boards wins, and among equals the one that fits best. That
is one-to-one by construction, needs no principal axes (which exchange places when they are nearly equally long), cannot be turned
by 180 degrees, cannot be mirrored, and does not mind missing boards. Boards that the map lacks are added by photos that name at
least two others; then all photos are named again with the whole map.

How a view follows from boards, on a plane or anywhere in space, is the business of `looks.py`.

A photo with a single board cannot say which one it is, and need not: equal boards serve alike, its pose is its own anyway.

Source: Kawka 2021, S2 and S4, where boards are matched by principal axes (methods/calibration.md).
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.naming.board_views import Look, PlaneLook, on_map, seen
from orthomill.tasks.geometry.rotation import nearest_rotation

NO_BOARDS = "No photograph shows a chessboard that could be used; check the number of inner corners."
_NEAR = 0.4
"""Largest mean distance of a board's corners from where they are predicted, in sizes of the board in the photo."""
LOOSE, STRICT = 0.12, 0.02
"""The same after all boards of the photo were fitted together: with distortion that is not known yet, and without any."""
_AMBIGUOUS = 2.0
"""Another naming of as many boards that fits up to so many times worse makes a photo ambiguous."""


@dataclass(frozen=True, eq=False)
class NamedPhoto:
    """`names` (B,): the number of the board in the map for every board found, -1 for none. `view` (3, 4) from the map to the
    photo (looks.py), None when nothing could be named. `certain`: False when a single board was named, for it could be any."""

    names: np.ndarray
    view: np.ndarray | None
    certain: bool


@dataclass(frozen=True, eq=False)
class Naming:
    """`places` (K, 4, 4): rigid motions of the boards into the system of board 0, the one nearest to the middle; photos in their
    order."""

    places: np.ndarray
    photos: tuple[NamedPhoto, ...]


def plane_looks(found: list[np.ndarray], local: np.ndarray) -> list[Look]:
    """found: per photo (B, N, 2) px from the image centre, y up, NaN for corners that are not known; local: (N, 2) m."""
    return [PlaneLook(xy, local) for xy in found]


def name_boards(looks: list[Look], local: np.ndarray, boards: int, fit: float = LOOSE) -> Naming:
    """Names the boards of all photos; local: (N, 2) m. `boards` that there are; 0: as many as the photos show. `fit`: LOOSE or
    STRICT.

    Raises GeometryError when no photo shows a board.
    """
    order = sorted(range(len(looks)), key=lambda photo: (-int(np.isfinite(looks[photo].xy).all(axis=(1, 2)).sum()), photo))
    if not order or not len(looks[order[0]].xy):
        raise GeometryError(NO_BOARDS)
    places = _map_of(looks[order[0]], local)
    for photo in order[1:]:
        places = _extended(places, _named(looks[photo], places, local, fit), looks[photo])
    photos = [_named(look, places, local, fit) for look in looks]
    places, photos = _without_strangers(places, photos, boards)
    return _averaged(places, photos, looks, local)


def _map_of(look: Look, local: np.ndarray) -> np.ndarray:
    """The boards of one photo in the system of its most central one: (B, 4, 4), S2 to S6."""
    middles = np.nanmean(look.xy, axis=1)
    centre = int(np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin())
    order = np.argsort(np.linalg.norm(middles - middles[centre], axis=1), kind="stable")
    places = np.eye(4)[None]
    for number, board in enumerate(order[1:], start=1):
        # Boards join from the middle outwards, so that the view of those before hardly extrapolates.
        view = look.view(order[:number], on_map(places, local))
        places = look.together(order[: number + 1], np.append(places, look.place(view, board)[None], axis=0))
    return places


def _named(look: Look, places: np.ndarray, local: np.ndarray, fit: float) -> NamedPhoto:
    """The best of all trials; of an ambiguous photo only its most central board, which may be any."""
    xy = look.xy
    best, score, second = NamedPhoto(np.full(len(xy), -1), None, False), (0, -np.inf), -np.inf
    points = on_map(places, local)
    size = np.array([np.linalg.norm(np.nanmax(board, axis=0) - np.nanmin(board, axis=0)) for board in xy])
    for board in range(len(xy)):
        for name in range(len(places)):
            names, view, misfit = _grown((board, name), look, points, size)
            trial = (int((names >= 0).sum()), -misfit)
            if not misfit < fit or trial[0] < score[0] or np.array_equal(names, best.names):
                continue
            if trial > score:
                second = score[1] if trial[0] == score[0] else -np.inf
                best, score = NamedPhoto(names, view, trial[0] > 1 or len(places) == 1), trial
            else:
                second = max(second, trial[1])
    ambiguous = score[0] > 1 and second > _AMBIGUOUS * score[1]
    return _most_central(best, xy) if ambiguous else best


def _most_central(photo: NamedPhoto, xy: np.ndarray) -> NamedPhoto:
    """The photo with a single name: two boards that lie to each other nearly as they do after exchanging places can be named in two
    ways, and a homography takes up the difference."""
    named = np.flatnonzero(photo.names >= 0)
    board = named[np.linalg.norm(np.nanmean(xy[named], axis=1), axis=1).argmin()]
    return NamedPhoto(np.where(np.arange(len(xy)) == board, photo.names, -1), photo.view, False)


def _grown(start: tuple[int, int], look: Look, points: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Names (B,), view and mean misfit (in sizes of a board) that follow from one pair."""
    names = np.full(len(look.xy), -1)
    names[start[0]] = start[1]
    while True:
        known = np.flatnonzero(names >= 0)
        view = look.view(known, points[names[known]])
        off = _misfits(look.xy, seen(view, points)) / size[:, None]
        own = off[known, names[known]]
        off[known], off[:, names[known]] = np.inf, np.inf
        board, name = np.unravel_index(off.argmin(), off.shape)
        if off[board, name] > _NEAR:
            return names, view, float(own.mean())
        names[board] = name


def _misfits(xy: np.ndarray, computed: np.ndarray) -> np.ndarray:
    """(B, K) px: mean distance of the known corners of each board (B, N, 2) from those computed for each board (K, N, 2) of the
    map; infinite where one lies behind the camera."""
    off = np.linalg.norm(xy[:, None] - computed[None], axis=3)
    known = np.isfinite(xy).all(axis=-1)[:, None]
    total = np.where(known, np.nan_to_num(off, nan=np.inf), 0.0).sum(axis=2)
    return total / known.sum(axis=2)


def _extended(places: np.ndarray, named: NamedPhoto, look: Look) -> np.ndarray:
    """The map with the boards that a photo shows besides two or more known ones."""
    unknown = np.flatnonzero(named.names < 0)
    if (named.names >= 0).sum() < 2:
        return places
    return np.concatenate([places, *(look.place(named.view, board)[None] for board in unknown)])


def _without_strangers(places: np.ndarray, photos: list[NamedPhoto], boards: int) -> tuple[np.ndarray, list[NamedPhoto]]:
    """Only the `boards` that most photos show (what else was found is no board), the most central one first."""
    times = np.array([sum(name in photo.names for photo in photos) for name in range(len(places))])
    kept = np.argsort(-times, kind="stable")[: boards or len(places)]
    kept = kept[times[kept] > 0]
    middle = places[kept, :3, 3].mean(axis=0)
    order = kept[np.argsort(np.linalg.norm(places[kept, :3, 3] - middle, axis=1), kind="stable")]
    number = np.full(len(places) + 1, -1)
    number[order] = np.arange(len(order))
    return places[order], [_renamed(photo, number) for photo in photos]


def _renamed(photo: NamedPhoto, number: np.ndarray) -> NamedPhoto:
    """The photo with new numbers; a single board is called board 0, which serves like any other."""
    names = number[photo.names]
    if not photo.certain:
        names = np.where(names >= 0, 0, -1)
    return NamedPhoto(names, photo.view, photo.certain)


def _averaged(places: np.ndarray, photos: list[NamedPhoto], looks: list[Look], local: np.ndarray) -> Naming:
    """The places of the boards as the median over the photos that show board 0, each refined by itself (S6), and the views of all
    photos in the system of board 0."""
    start = np.linalg.inv(places[0]) @ places
    seen_at: list[list[np.ndarray]] = [[] for _ in places]
    for photo, look in zip(photos, looks, strict=True):
        shown = np.flatnonzero(photo.names >= 0)
        shown = shown[np.argsort(photo.names[shown], kind="stable")]
        if len(shown) > 1 and photo.names[shown[0]] == 0:
            refined = look.together(shown, start[photo.names[shown]])
            for name, place in zip(photo.names[shown], refined, strict=True):
                seen_at[name].append(place)
    settled = np.array([_median(np.array(own)) if own else start[name] for name, own in enumerate(seen_at)])
    points = on_map(settled, local)
    return Naming(settled, tuple(_with_view(photo, look, points) for photo, look in zip(photos, looks, strict=True)))


def _median(places: np.ndarray) -> np.ndarray:
    """(4, 4) of places (n, 4, 4): the median shift, and the rotation nearest to the median of their matrices."""
    middle = np.median(places, axis=0)
    middle[:3, :3] = nearest_rotation(middle[:3, :3])
    return middle


def _with_view(photo: NamedPhoto, look: Look, points: np.ndarray) -> NamedPhoto:
    known = np.flatnonzero(photo.names >= 0)
    return replace(photo, view=look.view(known, points[photo.names[known]]) if len(known) else None)
