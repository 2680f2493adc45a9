"""Which board of one photo is which board of another: boards look alike, only their places tell them apart.

Strategy. The photo with the most boards gives a first map of them. A board has an origin and axes of its own, so that one board of
a photo taken for one board of the map already fixes a homography, turn and all; the nearest board that it predicts well is added,
the homography is fitted again, and so on outwards. Distortion and the error of the extrapolation are thus taken up as they grow.
Every pair of a photo's board and a map's board is tried; the trial that names most boards wins, and among equals the one that fits
best. That is one-to-one by construction, needs no principal axes (which exchange places when they are nearly equally long), cannot
be turned by 180 degrees, cannot be mirrored, and does not mind missing boards. Boards that the map lacks are added by photos that
name at least two others; then all photos are named again with the whole map.

A photo with a single board cannot say which one it is, and need not: equal boards serve alike, its pose is its own anyway.

Source: Kawka 2021, S2 and S4, where boards are matched by principal axes (methods/calibration.md).
"""

from dataclasses import dataclass

import numpy as np

from schemas.errors import GeometryError
from tasks.calibration.homographies import applied, homography, moved, refined_together, rigid_motion

_NEAR = 0.4
"""Largest mean distance of a board's corners from where they are predicted, in sizes of the board in the photo."""
LOOSE, STRICT = 0.12, 0.02
"""The same after all boards of the photo were fitted together: with distortion that is not known yet, and without any."""
_AMBIGUOUS = 2.0
"""Another naming of as many boards that fits up to so many times worse makes a photo ambiguous."""


@dataclass(frozen=True, eq=False)
class NamedPhoto:
    """`names` (B,): the number of the board in the map for every board found, -1 for none. `homography` (3, 3) from the map's
    plane to
    the photo, None when nothing could be named. `certain`: False when a single board was named, for it could be any."""

    names: np.ndarray
    homography: np.ndarray | None
    certain: bool


@dataclass(frozen=True, eq=False)
class Naming:
    """`motions` (K, 3): angle, x, y of the boards in the plane of board 0, the one nearest to the middle; photos in their order."""

    motions: np.ndarray
    photos: tuple[NamedPhoto, ...]


def name_boards(found: list[np.ndarray], local: np.ndarray, boards: int, fit: float = LOOSE) -> Naming:
    """Names the boards of all photos. found: per photo (B, N, 2) px from the image centre, y up, all corners of whole boards;
    local: (N, 2) m. `boards` that there are; 0: as many as the photos show. `fit`: LOOSE or STRICT.

    Raises GeometryError when no photo shows a board.
    """
    order = sorted(range(len(found)), key=lambda photo: -len(found[photo]))
    if not order or not len(found[order[0]]):
        raise GeometryError("No photograph shows a whole chessboard; check the number of inner corners.")
    motions = _map_of(found[order[0]], local)
    for photo in order[1:]:
        motions = _extended(motions, _named(found[photo], motions, local, fit), found[photo], local)
    photos = [_named(xy, motions, local, fit) for xy in found]
    motions, photos = _without_strangers(motions, photos, boards)
    return _averaged(motions, photos, found, local)


def _map_of(xy: np.ndarray, local: np.ndarray) -> np.ndarray:
    """The boards of one photo (B, N, 2) in the plane of its most central one: (B, 3), S2 to S6."""
    middles = xy.mean(axis=1)
    centre = int(np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin())
    order = np.argsort(np.linalg.norm(middles - middles[centre], axis=1), kind="stable")
    H, motions = homography(local, xy[centre]), [np.zeros(3)]
    for number, board in enumerate(order[1:], start=2):
        # Boards join from the middle outwards, so that the homography of those before hardly extrapolates.
        back = applied(np.linalg.inv(H), xy[board])
        motions.append(rigid_motion(local, back))
        H, refined = refined_together(H, np.array(motions), local, xy[order[:number]])
        motions = list(refined)
    return np.array(motions)


def _named(xy: np.ndarray, motions: np.ndarray, local: np.ndarray, fit: float) -> NamedPhoto:
    """The best of all trials; of an ambiguous photo only its most central board, which may be any."""
    best, score, second = NamedPhoto(np.full(len(xy), -1), None, False), (0, -np.inf), -np.inf
    plane = np.array([moved(motion, local) for motion in motions])
    size = np.array([np.linalg.norm(np.ptp(board, axis=0)) for board in xy])
    for board in range(len(xy)):
        for name in range(len(motions)):
            names, H, misfit = _grown((board, name), xy, plane, size)
            trial = (int((names >= 0).sum()), -misfit)
            if misfit >= fit or trial[0] < score[0] or np.array_equal(names, best.names):
                continue
            if trial > score:
                second = score[1] if trial[0] == score[0] else -np.inf
                best, score = NamedPhoto(names, H, trial[0] > 1 or len(motions) == 1), trial
            else:
                second = max(second, trial[1])
    ambiguous = score[0] > 1 and second > _AMBIGUOUS * score[1]
    return _most_central(best, xy) if ambiguous else best


def _most_central(photo: NamedPhoto, xy: np.ndarray) -> NamedPhoto:
    """The photo with a single name: two boards that lie to each other nearly as they do after exchanging places can be named in two
    ways, and a homography takes up the difference."""
    named = np.flatnonzero(photo.names >= 0)
    board = named[np.linalg.norm(xy[named].mean(axis=1), axis=1).argmin()]
    return NamedPhoto(np.where(np.arange(len(xy)) == board, photo.names, -1), photo.homography, False)


def _grown(start: tuple[int, int], xy: np.ndarray, plane: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Names (B,), homography and mean misfit (in sizes of a board) that follow from one pair."""
    names = np.full(len(xy), -1)
    names[start[0]] = start[1]
    while True:
        known = names >= 0
        H = homography(plane[names[known]].reshape(-1, 2), xy[known].reshape(-1, 2))
        computed = applied(H, plane)
        off = np.linalg.norm(xy[:, None] - computed[None], axis=3).mean(axis=2) / size[:, None]
        off = np.where(np.isfinite(off), off, np.inf)
        own = off[known, names[known]]
        off[known], off[:, names[known]] = np.inf, np.inf
        board, name = np.unravel_index(off.argmin(), off.shape)
        if off[board, name] > _NEAR:
            return names, H, float(own.mean())
        names[board] = name


def _extended(motions: np.ndarray, named: NamedPhoto, xy: np.ndarray, local: np.ndarray) -> np.ndarray:
    """The map with the boards that a photo shows besides two or more known ones."""
    unknown = np.flatnonzero(named.names < 0)
    if (named.names >= 0).sum() < 2:
        return motions
    back = np.linalg.inv(named.homography)
    return np.vstack([motions, *(rigid_motion(local, applied(back, xy[board]))[None] for board in unknown)])


def _without_strangers(motions: np.ndarray, photos: list[NamedPhoto], boards: int) -> tuple[np.ndarray, list[NamedPhoto]]:
    """Only the `boards` that most photos show (what else was found is no board), the most central one first."""
    times = np.array([sum(name in photo.names for photo in photos) for name in range(len(motions))])
    kept = np.argsort(-times, kind="stable")[: boards or len(motions)]
    kept = kept[times[kept] > 0]
    middle = motions[kept, 1:].mean(axis=0)
    order = kept[np.argsort(np.linalg.norm(motions[kept, 1:] - middle, axis=1), kind="stable")]
    number = np.full(len(motions) + 1, -1)
    number[order] = np.arange(len(order))
    return motions[order], [_renamed(photo, number) for photo in photos]


def _renamed(photo: NamedPhoto, number: np.ndarray) -> NamedPhoto:
    """The photo with new numbers; a single board is called board 0, which serves like any other."""
    names = number[photo.names]
    if not photo.certain:
        names = np.where(names >= 0, 0, -1)
    return NamedPhoto(names, photo.homography, photo.certain)


def _averaged(motions: np.ndarray, photos: list[NamedPhoto], found: list[np.ndarray], local: np.ndarray) -> Naming:
    """The motions of the boards as the median over the photos that show board 0, each refined by itself (S6), and the homographies
    of all photos in the plane of board 0."""
    plane = np.array([moved(motion, local) for motion in motions])
    seen: list[list[np.ndarray]] = [[] for _ in motions]
    for photo, xy in zip(photos, found, strict=True):
        shown = np.flatnonzero(photo.names >= 0)
        shown = shown[np.argsort(photo.names[shown], kind="stable")]
        if len(shown) > 1 and photo.names[shown[0]] == 0:
            # Into the plane of board 0, whose own corners are `local`.
            own = np.array([rigid_motion(local, moved_back(motions[0], plane[name])) for name in photo.names[shown]])
            H = homography(moved_back(motions[0], plane[photo.names[shown]]).reshape(-1, 2), xy[shown].reshape(-1, 2))
            _, refined = refined_together(H, own, local, xy[shown])
            for name, motion in zip(photo.names[shown], refined, strict=True):
                seen[name].append(motion)
    start = [rigid_motion(local, moved_back(motions[0], board)) for board in plane]
    settled = np.array([_median(motions_of) if motions_of else start[name] for name, motions_of in enumerate(seen)])
    return Naming(settled, tuple(_with_homography(photo, xy, settled, local) for photo, xy in zip(photos, found, strict=True)))


def moved_back(motion: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (..., 2) before a motion (angle, x, y)."""
    cos, sin = np.cos(motion[0]), np.sin(motion[0])
    return (points - motion[1:]) @ np.array([[cos, -sin], [sin, cos]])


def _median(motions: list[np.ndarray]) -> np.ndarray:
    motions = np.array(motions)
    angle = motions[0, 0] + np.median(np.angle(np.exp(1j * (motions[:, 0] - motions[0, 0]))))
    return np.append(angle, np.median(motions[:, 1:], axis=0))


def _with_homography(photo: NamedPhoto, xy: np.ndarray, motions: np.ndarray, local: np.ndarray) -> NamedPhoto:
    known = photo.names >= 0
    if not known.any():
        return NamedPhoto(photo.names, None, False)
    plane = np.array([moved(motions[name], local) for name in photo.names[known]])
    return NamedPhoto(photo.names, homography(plane.reshape(-1, 2), xy[known].reshape(-1, 2)), photo.certain)
