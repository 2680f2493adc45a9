"""What is cut away from the surface before it is shown. Photographs still see the whole: they were taken of it.

Every section is made of half-spaces, which triangles are clipped against; the parts keep the number of their triangle.

Source: Petsa et al. 2007 (sources/blending.md, M15), for any plane instead of a depth.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from orthomill.schemas.settings import Settings, setting

Point = tuple[float, float, float]
Convex = np.ndarray
"""(H, 4): n and d of half-spaces n X <= d whose intersection is a convex body"""


class NoSection(Settings):
    """The whole surface is shown."""

    kind: Literal["none"] = "none"


class PlaneSection(Settings):
    """What lies beyond a plane is cut away."""

    kind: Literal["plane"]
    point: Point = setting(..., "A point of the plane.", "m")
    normal: Point = setting(..., "Towards the side that is cut away; of any length.")

    @model_validator(mode="after")
    def _has_a_direction(self) -> "PlaneSection":
        if not np.any(self.normal):
            raise ValueError("the normal of a section is (0, 0, 0); give the direction towards the side that is cut away")
        return self


class BoxSection(Settings):
    """What lies in a box is cut away, or all that does not."""

    kind: Literal["box"]
    low: Point = setting(..., "Lowest X, Y, Z.", "m")
    high: Point = setting(..., "Highest X, Y, Z.", "m")
    keep: Literal["inside", "outside"] = setting("outside", "Which part remains.")


class PrismSection(Settings):
    """What stands on a polygon of the map is cut away, or all that does not."""

    kind: Literal["prism"]
    polygon: tuple[tuple[float, float], ...] = setting(..., "X, Y of the corners of a convex polygon, in turn.", "m", min_length=3)
    keep: Literal["inside", "outside"] = setting("outside", "Which part remains.")


Section = Annotated[NoSection | PlaneSection | BoxSection | PrismSection, Field(discriminator="kind")]
AnySection = NoSection | PlaneSection | BoxSection | PrismSection


def convex_body(section: PlaneSection | BoxSection | PrismSection, origin: np.ndarray) -> Convex:
    """The half-spaces (H, 4) of a section, relative to `origin` (3,)."""
    if section.kind == "plane":
        # What is cut away lies where n X >= n p.
        n = -np.array(section.normal) / np.linalg.norm(section.normal)
        body = np.array([[*n, n @ section.point]])
    elif section.kind == "box":
        low, high = np.minimum(section.low, section.high), np.maximum(section.low, section.high)
        body = np.vstack([np.column_stack([np.eye(3), high]), np.column_stack([-np.eye(3), -low])])
    else:
        corners = np.array(section.polygon)
        sides = np.roll(corners, -1, axis=0) - corners
        ahead = np.roll(sides, -1, axis=0)
        turn = np.sign((sides[:, 0] * ahead[:, 1] - sides[:, 1] * ahead[:, 0]).sum())
        n = turn * np.column_stack([sides[:, 1], -sides[:, 0], np.zeros(len(sides))])
        body = np.column_stack([n, (n[:, :2] * corners).sum(axis=1)])
    body[:, 3] -= body[:, :3] @ origin
    return body


def cut(section: AnySection, corners: np.ndarray, numbers: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a section leaves of triangles (T, 3, 3), relative to `origin`, and their numbers."""
    if section.kind == "none" or not len(corners):
        return corners, numbers
    body = convex_body(section, origin)
    inside = section.kind != "plane" and section.keep == "inside"
    rest, own, left = corners.astype(np.float64), numbers, []
    for half in body:
        beyond, beyond_own = clipped(rest, own, -half)
        if not inside:
            left.append((beyond, beyond_own))
        rest, own = clipped(rest, own, half)
    if inside:
        return rest, own
    return np.concatenate([part for part, _ in left]), np.concatenate([part for _, part in left])


def clipped(corners: np.ndarray, numbers: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parts of triangles (T, 3, 3) with n X <= d, `half` = (n, d), as triangles; with the numbers of their triangles."""
    distance = corners @ half[:3] - half[3]
    kept = (distance <= 0).sum(axis=1)
    whole, parts, own = corners[kept == 3], [], []
    for count in (1, 2):
        chosen = np.flatnonzero(kept == count)
        if not len(chosen):
            continue
        # The odd corner first, in the same sense of rotation: the one that stays, or the one that goes.
        odd = np.argmax((distance[chosen] <= 0) == (count == 1), axis=1)
        order = (odd[:, None] + np.arange(3)) % 3
        p = np.take_along_axis(corners[chosen], order[:, :, None], axis=1)
        d = np.take_along_axis(distance[chosen], order, axis=1)
        ab = p[:, 0] + (d[:, 0] / (d[:, 0] - d[:, 1]))[:, None] * (p[:, 1] - p[:, 0])
        ac = p[:, 0] + (d[:, 0] / (d[:, 0] - d[:, 2]))[:, None] * (p[:, 2] - p[:, 0])
        if count == 1:
            parts += [np.stack([p[:, 0], ab, ac], axis=1)]
            own += [numbers[chosen]]
        else:
            parts += [np.stack([ab, p[:, 1], p[:, 2]], axis=1), np.stack([ab, p[:, 2], ac], axis=1)]
            own += [numbers[chosen], numbers[chosen]]
    return np.concatenate([whole, *parts]), np.concatenate([numbers[kept == 3], *own])


def section_lines(corners: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Segments (S, 2, 3) in which triangles (T, 3, 3) meet the plane through `point` with `normal`."""
    distance = (corners - point) @ (np.asarray(normal, np.float64) / np.linalg.norm(normal))
    crossing = np.flatnonzero((distance.min(axis=1) < 0) & (distance.max(axis=1) >= 0))
    ends = np.full((len(crossing), 2, 3), np.nan)
    count = np.zeros(len(crossing), int)
    for k in range(3):
        a, b = distance[crossing, k], distance[crossing, (k + 1) % 3]
        met = np.flatnonzero(((a < 0) != (b < 0)) & (count < 2))
        share = (a[met] / (a[met] - b[met]))[:, None]
        here, there = corners[crossing[met], k], corners[crossing[met], (k + 1) % 3]
        ends[met, count[met]] = here + share * (there - here)
        count[met] += 1
    return ends[count == 2]
