"""The precision of the shape of the ground, apart from that of its place: how far it may be bent as a whole.

Strategy. Three quadratic forms over the tie points in plan (along the block, across it, and the twist), less their plane, describe
every bend. Their coefficients are linear in the heights, so that their covariance follows from that of the whole adjustment: a
point moves with all unknowns by -V^-1 W and with its own rays by V^-1 (back substitution). The eigenvector with the largest
variance is the bend that the block knows least; its standard error, as the range of heights over the block, is what is stated.
Place, tilt and scale, which a datum leaves open, have no part in it.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.model.linearisation import Linear, linearised
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.error_fields import TERMS, amplitudes, field_basis, weighted_rays
from orthomill.tasks.orientation.block.assembly import BlockResults

LEAST = 10
"""Points from which on forms with six coefficients say something of the ground"""
NARROW = 0.05
"""Width of a block in units of its length below which nothing can be said of a bend across it"""
ENDS = (1.0, 99.0)
"""Percentiles of the points between which the range of a bend counts: single points far outside are no part of the block."""


@dataclass(frozen=True)
class ShapePrecision:
    """`bend`: the standard error of the range of heights, m, that a bend of the ground adds over the block; `extent` (m) of the
    block along its length."""

    bend: float
    extent: float


def shape_precision(results: BlockResults) -> ShapePrecision | None:
    """The precision of the shape of the ground at the tie points; None for fewer than LEAST."""
    result, problem = results.result, results.problem
    # Points with two rays only are the least certain, and the first to be wrong.
    count = np.bincount(result.rays.point[result.used], minlength=len(result.state.point))
    count[result.network.kept] = 0
    points = np.flatnonzero(count >= 3) if (count >= 3).sum() >= LEAST else np.flatnonzero(count >= 2)
    if len(points) < LEAST:
        return None
    forms, extent = bend_forms(result.state.point[points, :2])
    values, vectors = np.linalg.eigh(form_covariance(result, points, forms, problem.frame_sizes))
    low, high = np.percentile(forms @ vectors[:, -1], ENDS)
    return ShapePrecision(float(np.sqrt(max(values[-1], 0.0)) * (high - low)), extent)


def bend_forms(xy: np.ndarray) -> tuple[np.ndarray, float]:
    """(N, 3) orthogonal quadratic forms with unit mean square at places (N, 2) m, without any plane; and the extent (m) along the
    longer axis. A narrow block has a form along it only, and a twist."""
    away = xy - xy.mean(axis=0)
    _, spread, axes = np.linalg.svd(away, full_matrices=False)
    u, v = (away @ axes.T / np.maximum(spread, 1e-12) * np.sqrt(len(xy))).T
    plane = np.column_stack([np.ones_like(u), u, v])
    forms = np.column_stack([u * u, u * v, v * v])[:, : 2 if spread[1] < NARROW * spread[0] else 3]
    forms = forms - plane @ np.linalg.lstsq(plane, forms, rcond=None)[0]
    low, high = np.percentile(away @ axes[0], ENDS)
    return np.linalg.qr(forms)[0] * np.sqrt(len(xy)), float(high - low)


def form_covariance(result: Adjustment, points: np.ndarray, forms: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(k, k) m^2: covariance of the coefficients of orthogonal `forms` (n, k) of unit mean square that fit the heights of `points`
    (n,); `size` (P, 2) px of the photographs. Considered parameters and correlated image errors are included."""
    rays = weighted_rays(result)
    linear = linearised(result.network, result.state, rays)
    # The coefficients are means of forms times heights: `pull` is what a unit of them asks of the block of each point.
    upward = np.zeros((len(linear.frame), forms.shape[1]))
    upward[points] = forms / len(points)
    inverse = np.linalg.pinv(_point_blocks(linear, rays), hermitian=True)
    pull = np.einsum("nab,nb,nk->nak", inverse, linear.frame[:, 2], upward)
    by_rays = linear.weight[:, None, None] * np.einsum("mia,mak->mik", linear.jp, pull[rays.point])
    by_unknowns = _by_unknowns(linear, by_rays, len(result.cofactor))
    moved = result.cofactor.inverse.times(by_unknowns)
    considered = result.cofactor.moves.T @ by_unknowns
    own = np.einsum("na,nal,nk->lk", linear.frame[:, 2], pull, upward)
    total = by_unknowns.T @ moved + considered.T @ considered + own + _by_fields(result, rays, by_rays, moved, size)
    return np.asarray(0.5 * (total + total.T))


def _point_blocks(linear: Linear, rays: Rays) -> np.ndarray:
    """(N, 3, 3) the normal matrices of the points in their frames."""
    blocks = np.zeros((len(linear.frame), 3, 3))
    np.add.at(blocks, rays.point, linear.weight[:, None, None] * np.einsum("mia,mib->mab", linear.jp, linear.jp))
    blocks[:, range(3), range(3)] += linear.point_weight
    return blocks


def _by_unknowns(linear: Linear, by_rays: np.ndarray, unknowns: int) -> np.ndarray:
    """(n, k) derivatives of the coefficients by the unknowns: -W' V^-1 times the forms."""
    out = np.zeros((unknowns + 1, by_rays.shape[2]))
    # Absent unknowns have the column -1: the row that is cut off.
    np.add.at(out, linear.columns[linear.row], -np.einsum("mia,mik->mak", linear.jg, by_rays))
    return out[:-1]


def _by_fields(result: Adjustment, rays: Rays, by_rays: np.ndarray, moved: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(k, k) the covariance of the forms by the fields of correlated errors, through the unknowns and through the rays of the
    points themselves; 0 where image errors are white."""
    motion, errors = result.cofactor.correlated, result.correlated
    if motion is None or errors is None:
        return np.zeros((by_rays.shape[2],) * 2)
    direct = np.zeros((result.network.photos, 2, TERMS, by_rays.shape[2]))
    basis = field_basis(rays.xy, size[rays.photo])
    np.add.at(direct, rays.photo, np.einsum("mik,mt->mitk", by_rays, basis))
    photos = np.unique(rays.photo)
    of_photos = direct[photos].reshape(len(photos) * 2 * TERMS, -1)
    of_cameras = np.zeros((len(result.network.interior.free), *direct.shape[1:]))
    np.add.at(of_cameras, result.network.camera_of[photos], direct[photos])
    own, shared = amplitudes(errors)
    # What one standard error of every coefficient does to the forms.
    fields = motion.pulls.T @ moved + np.vstack([own * of_photos, shared * of_cameras.reshape(-1, of_photos.shape[1])])
    return np.asarray(fields.T @ motion.unknown(fields))
