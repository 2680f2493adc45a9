"""How straight the orthoimage draws the edges that photographs show straight, beside the photographs themselves.

Strategy. An edge that all photographs show straight at a place is a line in space. Along it the orthoimage is followed, and so is
the photograph that looks down most steeply: in profiles across, the place where colours change as they do at the edge in the other
photographs, joined to the path of the greatest change that does not jump without a reason. A path that is displaced or turned as a
whole is still straight, so a line is taken off. What is left in the photograph is noise and what lies beside the edge; what is left
in the orthoimage besides is the comb that a surface of cells makes of an eave. No truth is needed.

Source: shortest path through a strip as in Ballard and Brown 1982, 4.5 (edge following by dynamic programming).
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy import ndimage

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph
from orthomill.tasks.imagery.edge_departures import peak_between, without_line
from orthomill.tasks.texture.edges.edge_positions import LEAST_CHANGE
from orthomill.tasks.texture.edges.edge_profiles import HALF_PIECE, EdgePlanes, edge_colours, lean_of
from orthomill.tasks.texture.edges.measured_edges import MeasuredEdges

PIECE = 10
"""px to both sides of a place, at most: as far as the photographs were asked whether the edge is straight"""
SEARCH = 5.0
"""px to both sides of the line in which it is looked for"""
STRAIGHT, SHOWING = 0.5, 3
"""px: residuals of the photographs at an edge that is straight in them (root mean square); photographs that must show it"""
_EVERY = 4  # one place in so many is judged: neighbours show the same piece
_PHOTOS = 4  # that are followed at a place, the steepest ones
_LEANING = 0.6  # m by which a metre of height displaces the edge at most: from farther aside walls cover what lies beside it
_STEPS = 2  # values of a profile for a pixel
_BLUR, _ALONG = 1.0, 0.7  # px: standard deviations of the Gaussians across, whose derivative is taken, and along the edge
_FADE = 4  # px that a profile is longer than its changes
_JUMP = 0.2  # of the change at the edge, for a jump of a pixel from profile to profile
_BESIDE = 1.0  # px to both sides of the path, in which the place of the greatest change is the edge
_MOST = 1.5  # of the change at the edge, that a stronger one beside it counts for
_SHARE = 0.4  # of the change at the edge, that a place on the path must have
_ENOUGH = 0.7  # of the profiles, in which the edge must be found
_AT_ONCE = 64  # places whose profiles are held, of all photographs at once


class DrawnEdges(BaseModel):
    """Sums over places at straight edges: of the places and those whose edge the orthoimage shows; of the squared departures from
    its line and their number, in the orthoimage and in the steepest photograph, px of the orthoimage."""

    model_config = ConfigDict(frozen=True)

    places: int = 0
    drawn: int = 0
    squares: float = 0.0
    profiles: int = 0
    photo_squares: float = 0.0
    photo_profiles: int = 0

    @property
    def jagged(self) -> float | None:
        """Departure in the orthoimage, px (root mean square); None where nothing was judged."""
        return sqrt(self.squares / self.profiles) if self.profiles else None

    @property
    def photo_jagged(self) -> float | None:
        """Departure in the photographs, px (root mean square); None where nothing was judged."""
        return sqrt(self.photo_squares / self.photo_profiles) if self.photo_profiles else None


def all_drawn(parts: list[DrawnEdges]) -> DrawnEdges:
    """The sums of all parts."""
    return DrawnEdges(**{name: sum(getattr(part, name) for part in parts) for name in DrawnEdges.model_fields})


class _Piece(NamedTuple):
    """Distances of the profiles from a place, and of their values from the line, px."""

    along: np.ndarray
    across: np.ndarray


def drawn_edges(
    edges: MeasuredEdges, grid: MapGrid, window: Window, ortho: np.ndarray, photos: list[BalancedPhotograph], divisor: int
) -> DrawnEdges:
    """Of the edges of a tile, whose orthoimage (rows, cols, 4) at the pixels `window` of `grid` is `ortho`; `divisor`: pixels along
    a cell; photos: parts that show the edges."""
    chosen = np.flatnonzero((edges.photos >= SHOWING) & (edges.rms <= STRAIGHT))[::_EVERY]
    half = min(PIECE, round(HALF_PIECE * divisor))
    wide = round((SEARCH + _FADE) * _STEPS)
    piece = _Piece(np.arange(-half, half + 1.0), np.arange(-wide, wide + 1) / _STEPS)
    most = 255.0 / np.iinfo(ortho.dtype).max
    picture = np.where(ortho[..., 3:] > 0, ortho[..., :3] * np.float32(most), np.float32(np.nan))
    parts = (chosen[first : first + _AT_ONCE] for first in range(0, len(chosen), _AT_ONCE))
    return all_drawn([_judged(edges.take(part), grid, window, picture, photos, piece) for part in parts])


def _judged(
    edges: MeasuredEdges, grid: MapGrid, window: Window, picture: np.ndarray, photos: list[BalancedPhotograph], piece: _Piece
) -> DrawnEdges:
    """The sums over some edges."""
    changes = _photo_changes(edges, grid.cell, photos, piece)
    own = _changes(_ortho_profiles(edges, grid, window, picture, piece))
    there = changes_at_edge(changes, piece.across)
    beside = changes_at_edge(changes[:, 1:], piece.across)
    # Where the orthoimage is cut off by the tile, or one photograph alone shows the piece, nothing is judged.
    asked = np.isfinite(own).any(axis=(2, 3)).all(axis=1) & (_length(beside) >= LEAST_CHANGE) & (_length(there) >= LEAST_CHANGE)
    in_ortho, in_photo = (
        found_pieces(edge_path(of[asked], at[asked], piece.across)) for of, at in ((own, there), (changes[:, 0], beside))
    )
    return DrawnEdges(
        places=int(asked.sum()),
        drawn=in_ortho.pieces,
        squares=float((in_ortho.left**2).sum()),
        profiles=in_ortho.left.size,
        photo_squares=float((in_photo.left**2).sum()),
        photo_profiles=in_photo.left.size,
    )


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.nan_to_num(np.sqrt((vectors**2).sum(axis=-1)))


def _changes(profiles: np.ndarray) -> np.ndarray:
    """Changes (..., T, S, C) of colours across the edges, grey levels per px, from profiles of the same shape."""
    slope = ndimage.gaussian_filter1d(profiles, _BLUR * _STEPS, axis=-2, order=1) * np.float32(_STEPS)
    return np.asarray(ndimage.gaussian_filter1d(slope, _ALONG, axis=-3))


def _ortho_profiles(edges: MeasuredEdges, grid: MapGrid, window: Window, picture: np.ndarray, piece: _Piece) -> np.ndarray:
    """Colours (N, T, S, 3) float32 of the orthoimage, bilinear; NaN beyond the tile and where it has none."""
    col, row = grid.pixel(edges.x, edges.y)
    # Columns and rows of a direction (x, y): rows run to the south.
    away, along = np.stack([edges.away_x, -edges.away_y]), np.stack([-edges.away_y, -edges.away_x])
    foot = np.stack([col - window.col, row - window.row])[:, :, None] + along[:, :, None] * piece.along
    at = foot[..., None] + away[:, :, None, None] * piece.across
    places = at[1], at[0]
    return np.stack([ndimage.map_coordinates(picture[..., k], places, order=1, cval=np.nan) for k in range(3)], axis=-1)


def _photo_changes(edges: MeasuredEdges, cell: float, photos: list[BalancedPhotograph], piece: _Piece) -> np.ndarray:
    """Changes (N, _PHOTOS, T, S, 3) float32 in the photographs that look down most steeply; NaN where there are fewer."""
    count = len(edges.x)
    planes = EdgePlanes(
        np.column_stack([edges.x, edges.y, edges.z]),
        np.column_stack([edges.away_x, edges.away_y]),
        np.column_stack([-edges.away_y, edges.away_x]),
        np.zeros(count),
        edges.climb,
    )
    lean = np.array([np.abs(lean_of(photo.view.centre, planes)) for photo in photos]).reshape(len(photos), count)
    shown = np.array([photo.view.contains(photo.view.project(planes.point)) for photo in photos]).reshape(len(photos), count)
    rank = np.argsort(np.argsort(np.where(shown, lean, np.inf), axis=0, kind="stable"), axis=0, kind="stable")
    out = np.full((count, _PHOTOS, len(piece.along), len(piece.across), 3), np.nan, np.float32)
    for k, photo in enumerate(photos):
        asked = np.flatnonzero(shown[k] & (rank[k] < _PHOTOS) & (lean[k] <= _LEANING))
        if len(asked):
            inside, colours = edge_colours(
                photo.view, photo.part, EdgePlanes(*(values[asked] for values in planes)), cell, piece.along, piece.across
            )
            out[asked[inside], rank[k, asked[inside]]] = colours * np.float32(255.0 / photo.balance.white)
    return _changes(out)


def changes_at_edge(changes: np.ndarray, across: np.ndarray) -> np.ndarray:
    """The mean change (N, C) at the edge of photographs (N, P, T, S, C), at the one place within a pixel of the line where it is
    greatest; NaN where no photograph shows all of it."""
    near = changes[:, :, :, np.abs(across) <= 1.0]
    whole = np.isfinite(near).all(axis=(2, 3, 4))
    total = np.where(whole[:, :, None, None], near.mean(axis=2), 0.0).sum(axis=1)
    count = whole.sum(axis=1)
    mean = total / np.where(count > 0, count, np.nan)[:, None, None]
    best = np.argmax((np.nan_to_num(mean) ** 2).sum(axis=-1), axis=1)
    return np.asarray(mean[np.arange(len(mean)), best])


def edge_path(changes: np.ndarray, there: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Where an edge lies in each profile (N, T), px from the line; NaN where it is not found.

    changes (N, T, S, C): of the colours, at the distances `across` (S,) px; there (N, C): the change at the edge.
    """
    length = _length(there)[:, None, None]
    tried = np.abs(across) <= SEARCH
    alike = np.einsum("ntsc,nc->nts", changes[:, :, tried], there) / np.maximum(length, 1e-9) ** 2
    score = np.where(np.isfinite(alike), np.minimum(alike, _MOST), -_MOST)
    path = _best_path(score, _JUMP / _STEPS)
    # A path spares jumps; the edge itself is where the change is greatest beside it.
    near = np.abs(np.arange(score.shape[-1]) - path[..., None]) <= _BESIDE * _STEPS
    path = np.where(near & np.isfinite(alike), alike, -np.inf).argmax(axis=-1)
    inside = np.clip(path, 1, score.shape[-1] - 2)
    # At the ends of the search the edge may lie anywhere beyond; comparisons with NaN are false.
    found = (path == inside) & (np.take_along_axis(alike, inside[..., None], axis=-1)[..., 0] >= _SHARE)
    return np.where(found, (inside + peak_between(alike, inside)) / _STEPS + across[tried][0], np.nan)


def _best_path(score: np.ndarray, jump: float) -> np.ndarray:
    """Steps (N, T) of the path through scores (N, T, S) with the greatest sum, less `jump` for every step to a neighbour's."""
    count = score.shape[-1]
    apart = jump * np.abs(np.arange(count)[:, None] - np.arange(count))
    total, before = score[:, 0], []
    for k in range(1, score.shape[1]):
        reached = total[:, None, :] - apart
        before.append(reached.argmax(axis=-1))
        total = reached.max(axis=-1) + score[:, k]
    path = np.empty(score.shape[:2], np.int64)
    path[:, -1] = total.argmax(axis=-1)
    for k in range(score.shape[1] - 2, -1, -1):
        path[:, k] = np.take_along_axis(before[k], path[:, k + 1, None], axis=1)[:, 0]
    return path


class FoundPieces(NamedTuple):
    """Number of the pieces whose edge was found, and departures (M,) px of their profiles from their lines."""

    pieces: int
    left: np.ndarray


def found_pieces(away: np.ndarray) -> FoundPieces:
    """Of displacements (N, T) px along edges, NaN where they are not found."""
    known = np.isfinite(away)
    enough = known.mean(axis=1) >= _ENOUGH if away.size else np.zeros(len(away), bool)
    left = without_line(away[enough])
    return FoundPieces(int(enough.sum()), left[np.isfinite(left)])
