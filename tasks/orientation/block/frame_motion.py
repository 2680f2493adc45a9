"""How the photographs moved while they were exposed: speeds by positions and times, distances by tie points."""

from datetime import datetime

import numpy as np

from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.image_variation import FrameMotion
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.orientation.block.assembly import Problem

LONGEST = 30.0
"""s: the speed between photographs farther apart in time says nothing of the moment of either"""
FORMATS = ("%Y:%m:%d %H:%M:%S", "%Y:%m:%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S", "%Y-%m-%dT%H:%M:%S.%f")


def frame_motion(problem: Problem, photos: Photos, network: Network, state: State, rays: Rays) -> FrameMotion:
    """The motion of the photographs of a block at its starting values."""
    height = np.array([problem.cameras[k].height for k in problem.camera_of], float)
    towards = state.point[rays.point] - state.centre[rays.photo]
    depth = -np.einsum("mj,mj->m", state.rotation[rays.photo, 2], towards)
    order = np.argsort(rays.photo, kind="stable")
    by_photo = np.split(depth[order], np.searchsorted(rays.photo[order], np.arange(1, len(height))))
    own = np.array([np.median(depths) if len(depths) else np.nan for depths in by_photo])
    times = np.array([_seconds(photos[name].time) for name in problem.names])
    velocity = _velocities(problem.known.position, times)
    return FrameMotion(
        state.interior[problem.camera_of, 0],
        height,
        np.where(np.isfinite(own), own, np.nanmedian(own)),
        np.einsum("pij,pj->pi", state.rotation, velocity) * (np.nan if network.free else 1.0),
    )


def _seconds(time: str | None) -> float:
    """The time of a photograph in seconds since any moment; NaN where it is not known."""
    for form in FORMATS:
        try:
            return (datetime.strptime(time or "", form) - datetime(2000, 1, 1)).total_seconds()
        except ValueError:
            continue
    return np.nan


def _velocities(position: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(P, 3) m/s between the photographs before and after each (one of them at the ends of a strip); NaN where unknown."""
    out = np.full(position.shape, np.nan)
    known = np.flatnonzero(np.isfinite(times) & np.isfinite(position).all(axis=1))
    order = known[np.argsort(times[known], kind="stable")]
    for at, photo in enumerate(order):
        near = [other for other in (order[max(at - 1, 0)], order[min(at + 1, len(order) - 1)]) if _close(times, photo, other)]
        first, last = (near[0], near[-1]) if len(near) == 2 else (near[0], photo) if near else (photo, photo)
        if times[last] != times[first]:
            out[photo] = (position[last] - position[first]) / (times[last] - times[first])
    return out


def _close(times: np.ndarray, photo: int, other: int) -> bool:
    return bool(photo != other and 0 < abs(times[other] - times[photo]) <= LONGEST)
