"""Blunders planted in the observations of a simulated block, one of every kind, and what an adjustment names."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from simulated_block import SimulatedBlock

from orthomill.schemas.camera import Cameras
from orthomill.schemas.observations import Control, ControlPoint

NAMING = {
    "control_contradicted": ("point",),
    "position_contradicted": ("photo",),
    "distance_contradicted": ("first", "second"),
    "measurements_rejected": ("point",),
    "check_measurements_apart": ("point",),
    "constant_contradicted": ("camera",),
    "datum_given_up": ("worst",),
}
"""Findings that name an observation as wrong, and where they hold its name."""
WITHOUT_NAMES = ("positions_elsewhere", "positions_along_view", "datum_misfit", "looks_upward", "axes_exchanged", "block_separate")
"""Findings that blame many observations together."""
MOST = 0.99
"""Share of the wrong tie measurements in points of three rays or more that are to be rejected."""


@dataclass(frozen=True)
class Planted:
    """A block with a blunder of a kind, and what has to be `named` (all of these words)."""

    kind: str
    block: SimulatedBlock
    named: frozenset[str]


def planted(block: SimulatedBlock, distance: float, seed: int) -> Iterator[Planted]:
    """The block as it is, and with every blunder that its observations can have; `distance` (m) to what the photographs show."""
    rng = np.random.default_rng([11, seed])
    yield Planted("none", block, frozenset())
    if block.photos.photos[0].position is not None:
        yield _position(block, rng)
    control = [point for point in block.control.points if point.role == "control"]
    if control:
        yield _coordinate(block, control, distance, rng)
        yield _pointing(block, control, rng)
        yield _exchanged(block, control, rng)
    if block.control.distances:
        yield _distance(block, rng)
    yield _ties(block, rng)
    yield _photograph(block, rng)


def _position(block: SimulatedBlock, rng) -> Planted:
    """One position off by fifteen of its standard errors in a level direction, 100 of them where they are centimetres."""
    at = int(rng.integers(len(block.photos.photos)))
    photo, turn = block.photos.photos[at], rng.uniform(0, 2 * np.pi)
    size = photo.position_sigma[0] * (15 if photo.position_sigma[0] > 0.5 else 100)
    moved = np.array(photo.position) + size * np.array([np.cos(turn), np.sin(turn), 0])
    photos = list(block.photos.photos)
    photos[at] = photo.model_copy(update={"position": tuple(map(float, moved))})
    return Planted(
        "position", replace(block, photos=block.photos.model_copy(update={"photos": tuple(photos)})), frozenset({photo.name})
    )


def _with(block: SimulatedBlock, *points: ControlPoint) -> SimulatedBlock:
    own = {point.name: point for point in points}
    changed = tuple(own.get(point.name, point) for point in block.control.points)
    return replace(block, control=Control(points=changed, distances=block.control.distances))


def _coordinate(block: SimulatedBlock, control, distance: float, rng) -> Planted:
    """One coordinate of a control point off by a fortieth of the distance: a misread decimetre of a facade, metres from the air."""
    point, axis = control[rng.integers(len(control))], int(rng.integers(3))
    xyz = list(point.xyz)
    xyz[axis] += distance / 40 * (1 if rng.random() < 0.5 else -1)
    return Planted("control coordinate", _with(block, point.model_copy(update={"xyz": tuple(xyz)})), frozenset({point.name}))


def _pointing(block: SimulatedBlock, control, rng) -> Planted:
    """One measurement of a control point 40 px away."""
    point, turn = control[rng.integers(len(control))], rng.uniform(0, 2 * np.pi)
    photo = sorted(point.measurements)[rng.integers(len(point.measurements))]
    col, row, sigma = point.measurements[photo]
    wrong = (col + 40 * np.cos(turn), row + 40 * np.sin(turn), sigma)
    measurements = {**point.measurements, photo: wrong}
    return Planted("pointing", _with(block, point.model_copy(update={"measurements": measurements})), frozenset({point.name}))


def _exchanged(block: SimulatedBlock, control, rng) -> Planted:
    """Two control points exchanged in a photograph that shows both; without such a photograph, in all."""
    pairs = [(a, b, p) for a in control for b in control if a.name < b.name for p in sorted(a.measurements.keys() & b.measurements)]
    if not pairs:
        a, b = control[:2]
        one, other = a.model_copy(update={"xyz": b.xyz}), b.model_copy(update={"xyz": a.xyz})
        return Planted("exchanged names", _with(block, one, other), frozenset({a.name, b.name}))
    a, b, photo = pairs[rng.integers(len(pairs))]
    one = a.model_copy(update={"measurements": {**a.measurements, photo: b.measurements[photo]}})
    other = b.model_copy(update={"measurements": {**b.measurements, photo: a.measurements[photo]}})
    return Planted("exchanged names", _with(block, one, other), frozenset({a.name, b.name}))


def _distance(block: SimulatedBlock, rng) -> Planted:
    at = int(rng.integers(len(block.control.distances)))
    wrong = block.control.distances[at]
    distances = list(block.control.distances)
    distances[at] = wrong.model_copy(update={"length": 1.1 * wrong.length})
    control = Control(points=block.control.points, distances=tuple(distances))
    return Planted("distance", replace(block, control=control), frozenset({wrong.first, wrong.second}))


def _ties(block: SimulatedBlock, rng) -> Planted:
    """Every twentieth measurement of tie points 20 to 80 px away."""
    ties = block.tie_points
    wrong = rng.random(len(ties.track)) < 0.05
    turn, size = rng.uniform(0, 2 * np.pi, len(wrong)), rng.uniform(20, 80, len(wrong)) * wrong
    moved = replace(ties, col=ties.col + size * np.cos(turn), row=ties.row + size * np.sin(turn))
    return Planted("tie points", replace(block, tie_points=moved, wrong=wrong), frozenset())


def _photograph(block: SimulatedBlock, rng) -> Planted:
    """A photograph that shows something else: its matches are all wrong."""
    at = int(rng.integers(len(block.photos.photos)))
    ties, photo = block.tie_points, block.photos.photos[at]
    own, points = np.flatnonzero(ties.photo == at), []
    col, row = ties.col.copy(), ties.row.copy()
    col[own], row[own] = rng.uniform(5, photo.width - 5, len(own)), rng.uniform(5, photo.height - 5, len(own))
    # A person does not point at control where the photograph does not show it.
    for point in block.control.points:
        seen = {name: measured for name, measured in point.measurements.items() if name != photo.name}
        points.append(point.model_copy(update={"measurements": seen}))
    changed = replace(_with(block, *points), tie_points=replace(ties, col=col, row=row), wrong=ties.photo == at)
    return Planted("photograph", changed, frozenset({photo.name}))


def with_constant(block: SimulatedBlock, factor: float) -> Planted:
    """The block with a camera constant that is wrong by a factor."""
    camera = block.cameras.cameras["cam"]
    cameras = Cameras(cameras={"cam": camera.changed(c=factor * camera.c)}, of_photo=block.cameras.of_photo)
    return Planted("camera constant", replace(block, cameras=cameras), frozenset({"cam"}))


def named_by(out: dict) -> frozenset[str]:
    """What an adjustment names as wrong: words of its findings, photographs that it left out, `many` for what blames many."""
    names = {photo.photo for photo in out["block"].unoriented}
    for finding in out["precision"].findings:
        for field in NAMING.get(finding.code, ()):
            value = getattr(finding, field)
            names |= {value} if isinstance(value, str) else set(value)
        if finding.code in WITHOUT_NAMES:
            names.add(finding.code)
    return frozenset(names)


def is_named(one: Planted, out: dict) -> bool:
    """Whether the planted blunder is named: all its words; of wrong tie measurements, those that others contradict."""
    if one.kind != "tie points":
        return one.named <= named_by(out)
    used = {(t, p) for t, p, u in zip(*(getattr(out["image_residuals"], c) for c in ("track", "photo", "used")), strict=True) if u}
    ties = one.block.tie_points
    right = np.bincount(ties.track[~one.block.wrong], minlength=ties.track.max() + 1)
    testable = np.flatnonzero(one.block.wrong & (right[ties.track] >= 3))
    left = [(int(ties.track[i]), int(ties.photo[i])) in used for i in testable]
    return float(np.mean(left)) <= 1 - MOST


def nothing_else(one: Planted, out: dict) -> bool:
    """Whether nothing that is right is named as wrong; a photograph of something else may leave others without a connection."""
    apart = {"block_separate"} if one.kind == "photograph" else set()
    return named_by(out) <= one.named | apart
