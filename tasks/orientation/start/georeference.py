"""From a model in a system of its own to the project's system: which observations define the datum, and how strongly.

Positions of the projection centres and control points together define location, orientation and scale, as far as they can. Points
on one line leave the rotation about it undetermined: then (and only then) the mean up direction of the photographs serves as a
verticality constraint with a stated standard error, and the datum sentence says so. With fewer than two known points the network is
free.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.datum_findings import (
    BASIS,
    AxesExchanged,
    ControlOnALine,
    DatumGivenUp,
    DatumMisfit,
    LooksUpward,
    NoDatum,
    PositionsCrowded,
    TiltUnobserved,
)
from orthomill.schemas.raster import NO_UNIT
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.orientation.orientation_settings import Looking
from orthomill.tasks.orientation.start.dominant_plane import dominant_plane
from orthomill.tasks.orientation.start.similarity import (
    Similarity,
    VerticalityConstraint,
    approximate_scale,
    consensus,
    fit_similarity,
    turn_precision,
)
from orthomill.tasks.orientation.start.up_direction import DOWN, Basis, expected_up, up_direction

WEAK_TURN = np.radians(1.0)
"""A rotation about the line of the known points that is less precise needs the verticality constraint: one degree moves the ground
below a strip flown at 100 m by 1.7 m."""
CROWDED = 3.0
"""Known points within so many of their standard errors of each other give neither scale nor direction."""
BENDS = 0.02
"""A free model is deformed by up to this share of its extent, because nothing but its own tie points determines its shape."""
OTHERWISE = 3.0
"""Points contradict what is assumed of the vertical where they put it elsewhere by so many standard errors of both."""
UPWARD = 0.5
"""The photographs look upwards (or downwards) where the vertical component of their mean axis exceeds this."""
FAR = 5.0
"""Known points whose residual from the consensus exceeds so many tolerances are set aside; nearer ones the blunder test
examines."""
ELSEWHERE = 45.0
"""degrees between the mean axes of two groups of one flight: no assumption about the tilt holds for both"""
WORST = 3
"""Observations that are named where a block could not be adjusted with them."""
ONE_SIDED = 0.1
"""Control lies on one line where its extent across is smaller than this share of its extent along."""
MISFIT = 4.0
"""Median misfit, in standard errors, from which positions and control are reported to disagree with the shape of the block."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known in the project's system: `position`, `position_sigma` (P, 3) of the placed photographs (NaN: unknown);
    `control`, `control_sigma` (n, 3) of the surveyed points (NaN and inf: only measured in photographs); `control_model` (n, 3)
    where the model has them (NaN: cannot be intersected); `up` (P, 3) the up directions in the image systems by attitudes (NaN:
    unknown), `top` (P, 3) the directions to the tops of the photographs there; `distances`: numbers of two surveyed points, length,
    standard error, m; how many control points are `measured` in two photographs or more, and of these the rays do not meet
    (`unmet`); `blur` (n,): the standard error of a coordinate of `control_model` by the marks in the photographs, in units of the
    model (0: none).
    """

    position: np.ndarray
    position_sigma: np.ndarray
    control: np.ndarray
    control_sigma: np.ndarray
    control_model: np.ndarray
    up: np.ndarray
    top: np.ndarray
    distances: tuple[tuple[int, int, float, float], ...] = ()
    measured: int = 0
    unmet: int = 0
    blur: np.ndarray | float = 0.0

    @property
    def positioned(self) -> np.ndarray:
        """(P,) bool: photographs with a known position."""
        return np.isfinite(self.position).all(axis=1)

    @property
    def placed(self) -> np.ndarray:
        """(n,) bool: control points that were intersected in the model."""
        return np.isfinite(self.control_model).all(axis=1) & np.isfinite(self.control).all(axis=1)


@dataclass(frozen=True, eq=False)
class Datum:
    """The datum of a block: `similarity` into local coordinates, `origin` (3,) to be added to these, whether the network is free,
    the expected `up` directions (P, 3) in the image systems (NaN: unknown; None: no verticality constraint is needed), findings for
    the report, which positions (P,) and control points (n,) are set aside because they lie elsewhere, the reference system of the
    block where it is not the project's, and what the tilt rests on where an assumption has to give it (`basis`)."""

    similarity: Similarity
    origin: np.ndarray
    free: bool
    up: np.ndarray | None
    sentence: str
    findings: tuple[BlockFinding, ...]
    positions_aside: np.ndarray
    control_aside: np.ndarray
    system: str | None = None
    basis: Basis | None = None


@dataclass(frozen=True, eq=False)
class _CommonPoints:
    """Projection centres and control points that are known both in the model and in the project's system: `model`, `ground` (n, 3),
    `sigma` (n,) m, `surveyed` (n,) bool: control points."""

    model: np.ndarray
    ground: np.ndarray
    sigma: np.ndarray
    surveyed: np.ndarray

    @property
    def origin(self) -> np.ndarray:
        """(3,) m: the origin of local coordinates, a round number near the site; by control where it is enough to trust it
        alone."""
        return np.round(np.median(self.ground[self.surveyed] if self.surveyed.sum() >= 3 else self.ground, axis=0))

    @property
    def local(self) -> np.ndarray:
        """(n, 3) m: ground coordinates less the origin; map coordinates of millions of metres would cost the adjustment its
        digits."""
        return self.ground - self.origin

    @property
    def usable(self) -> bool:
        """Whether there are two different points."""
        return len(self.model) >= 2 and bool(np.ptp(self.model, axis=0).max() > 0)

    @property
    def crowded(self) -> bool:
        """Whether the points lie within their standard errors of each other, the surveyed ones by themselves as well: of an object
        of two metres a phone's positions say nothing, and four points on it all."""
        return all(self._crowded(some) for some in (self.surveyed, np.ones(len(self.ground), bool)) if some.sum() >= 2)

    def _crowded(self, some: np.ndarray) -> bool:
        return bool(np.linalg.norm(np.ptp(self.ground[some], axis=0)) < CROWDED * np.median(self.sigma[some]))


@dataclass(frozen=True, eq=False)
class _DatumFit:
    """The similarity that most points agree on, and which these are (n,) bool; of these the standard errors (m,), the residuals (m,
    3) and the extent, m; the standard error (rad) of the rotation about their line, and whether the verticality constraint `held`
    it."""

    similarity: Similarity
    near: np.ndarray
    sigma: np.ndarray
    residual: np.ndarray
    extent: float
    turn: float
    held: bool

    @property
    def weak(self) -> bool:
        """Whether the points determine the rotation about their line poorly."""
        return self.turn > WEAK_TURN


def choose_datum(
    model: State, known: Known, vertical_sigma: float, looking: Looking, shift: bool, origin: np.ndarray | None = None
) -> Datum:
    """The datum of a model. `vertical_sigma` (rad) and `looking` are used only where the known points leave a rotation
    undetermined. `shift`: the positions may have a common error. `origin` (3,): the model is in a system of given orientations
    already, less this origin."""
    points = _common_points(model, known, shift)
    if not points.usable:
        return _free(model, known, origin)
    if points.crowded:
        free = _free(model, known, origin, approximate_scale(points.model, points.local, points.sigma))
        return replace(free, findings=(*free.findings, PositionsCrowded()))
    up, basis = expected_up(model.rotation, known.up, known.top, looking, _direction(points.model))
    fit = _fit(points, VerticalityConstraint(up_direction(model.rotation, up), 1.0 / vertical_sigma**2), basis != "attitude")
    # Positions lie above the ground by themselves; only control can turn a block upside down.
    looks_up = None if known.positioned.any() else _looks_up(model, points, fit)
    if isinstance(looks_up, AxesExchanged):
        return replace(_free(model, known, None), findings=(looks_up,))
    return _placed_datum(known, points, fit, up, basis, vertical_sigma, looks_up)


def given_up(model: State, known: Known, datum: Datum, photos: tuple[str, ...], points: tuple[str, ...]) -> Datum:
    """The free datum of a block that could not be adjusted in `datum`, with a finding that names the observations that pull most;
    `photos` (P,) and `points` (n,) are their names."""
    control = np.linalg.norm(datum.similarity.apply(known.control_model) + datum.origin - known.control, axis=1)
    position = np.linalg.norm(datum.similarity.apply(model.centre) + datum.origin - known.position, axis=1)
    # In standard errors, as the adjustment weighs them; NaN where there is nothing to compare.
    sizes = np.nan_to_num(
        np.concatenate([control / known.control_sigma.max(axis=1), position / known.position_sigma.max(axis=1)]), posinf=0.0
    )
    names = (*points, *photos)
    worst = tuple(names[i] for i in np.argsort(-sizes, kind="stable")[:WORST] if sizes[i] > 0)
    free = _free(model, known, None)
    return replace(free, findings=(*free.findings, DatumGivenUp(worst=worst)))


def looks_elsewhere(model: State, datum: Datum, block: State, of_block: Datum) -> bool:
    """Whether photographs whose tilt only an assumption gives look elsewhere than those of the `block`, so that nothing tells
    their tilt: two photographs that wrong matches joined turn to any side about the line of their positions."""
    if datum.free or of_block.free or datum.basis not in ("down", "level"):
        return False
    axes = [(-one.rotation[:, 2]).mean(axis=0) @ own.similarity.rotation.T for one, own in ((model, datum), (block, of_block))]
    cosine = axes[0] @ axes[1] / max(float(np.prod([np.linalg.norm(axis) for axis in axes])), 1e-12)
    return bool(cosine < np.cos(np.radians(ELSEWHERE)))


def free_of_its_place(model: State, known: Known) -> Datum:
    """The datum of photographs whose positions do not place them: a free network."""
    return _free(model, known, None)


def _placed_datum(
    known: Known,
    points: _CommonPoints,
    fit: _DatumFit,
    up: np.ndarray,
    basis: Basis,
    vertical_sigma: float,
    looks_up: LooksUpward | None,
) -> Datum:
    has, placed = known.positioned, known.placed
    aside = np.zeros(len(has), bool), np.zeros(len(placed), bool)
    aside[0][has], aside[1][placed] = ~fit.near[~points.surveyed], ~fit.near[points.surveyed]
    findings = _findings(fit, basis, vertical_sigma, known.control[placed & ~aside[1]])
    findings += (looks_up,) if looks_up else ()
    positions, control = int((has & ~aside[0]).sum()), int((placed & ~aside[1]).sum())
    rests = basis if fit.held else None
    sentence = datum_sentence(positions, control, rests)
    return Datum(fit.similarity, points.origin, False, up if fit.held else None, sentence, findings, *aside, basis=rests)


def _common_points(model: State, known: Known, shift: bool) -> _CommonPoints:
    has, placed = known.positioned, known.placed
    position = _without_shift(model, known) if shift and placed.sum() >= 3 else known.position
    sigma = np.vstack([known.position_sigma[has], known.control_sigma[placed]])
    source = np.vstack([model.centre[has], known.control_model[placed]])
    target = np.vstack([position[has], known.control[placed]])
    surveyed = np.arange(len(source)) >= has.sum()
    # What a surveyed point misses its place in the model by is its own error and that of its marks.
    blur = np.zeros(len(source))
    blur[surveyed] = np.broadcast_to(known.blur, placed.shape)[placed] * _rough_scale(source, target, surveyed)
    return _CommonPoints(source, target, np.sqrt((sigma**2).mean(axis=1) + blur**2), surveyed)


def _rough_scale(model: np.ndarray, ground: np.ndarray, surveyed: np.ndarray) -> float:
    """m per unit of the model, by how far points (n, 3) lie apart; by control where there are two points of it; 0 without any."""
    own = surveyed if surveyed.sum() >= 2 else np.ones(len(model), bool)
    if not own.any():
        return 0.0
    apart = [np.linalg.norm(each[own] - np.median(each[own], axis=0), axis=1) for each in (ground, model)]
    # Medians: a few wrong points do not make a block larger.
    return float(np.median(apart[0]) / max(np.median(apart[1]), 1e-300))


def _fit(points: _CommonPoints, constraint: VerticalityConstraint, assumed: bool) -> _DatumFit:
    """The similarity of the points near the consensus, with the verticality constraint where these need it and do not show that it
    was wrongly `assumed`."""
    local, sigma, none = points.local, np.maximum(points.sigma, 1e-6), replace(constraint, weight=0.0)
    on_a_line = turn_precision(points.ground, sigma) > WEAK_TURN
    near = consensus(points.model, local, sigma, constraint if on_a_line else none, points.surveyed) < FAR
    if near.sum() < 2:
        near[:] = True
    extent = float(np.linalg.norm(np.ptp(points.ground[near], axis=0)))
    # Not better than 1e-4 of the extent: a free model has errors of its own, and millimetres would let two points decide.
    sigma = np.maximum(points.sigma, 1e-4 * extent)
    turn = turn_precision(points.ground[near], sigma[near])
    similarity = fit_similarity(points.model[near], local[near], sigma[near], none)
    held = turn > WEAK_TURN and not (assumed and _is_otherwise(similarity, constraint, turn))
    if held:
        similarity = fit_similarity(points.model[near], local[near], sigma[near], constraint)
    return _DatumFit(similarity, near, sigma[near], (similarity.apply(points.model) - local)[near], extent, turn, held)


def _is_otherwise(similarity: Similarity, constraint: VerticalityConstraint, turn: float) -> bool:
    """Whether points that determine the tilt to `turn` rad, better than the constraint does, contradict it."""
    allowed = 1.0 / np.sqrt(constraint.weight)
    # Points on one line seem to determine a tilt by chance, but never as well as that.
    if turn > allowed:
        return False
    off = np.arccos(np.clip((similarity.rotation @ constraint.direction)[2], -1.0, 1.0))
    return bool(off > OTHERWISE * np.hypot(turn, allowed))


def _direction(points: np.ndarray) -> np.ndarray:
    """The direction (3,) of the line that fits points (n, 3) best."""
    return np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]


def _looks_up(model: State, points: _CommonPoints, fit: _DatumFit) -> AxesExchanged | LooksUpward | None:
    """Whether the photographs look upwards by their control. With X and Y exchanged, control shows the ground in a mirror, which is
    nearly the ground seen from below."""
    if (fit.similarity.rotation @ mean_up(model))[2] > -UPWARD:
        return None
    source, target = points.model[fit.near], points.local[fit.near]
    exchanged = target[:, [1, 0, 2]]
    other = fit_similarity(source, exchanged, fit.sigma, VerticalityConstraint(mean_up(model), 0.0))
    own, better = rms(fit.similarity, source, target), rms(other, source, exchanged)
    if (other.rotation @ mean_up(model))[2] > UPWARD and 2.0 * better < own:
        return AxesExchanged(exchanged_m=better, given_m=own)
    return LooksUpward()


def rms(similarity: Similarity, source: np.ndarray, target: np.ndarray) -> float:
    """Root mean square length of the residuals, m."""
    return float(np.sqrt(((similarity.apply(source) - target) ** 2).sum(axis=1).mean()))


def mean_up(model: State) -> np.ndarray:
    """Mean axis (3,) of the photographs, from the ground to the cameras."""
    return up_direction(model.rotation, np.tile(DOWN, (len(model.rotation), 1)))


def _without_shift(model: State, known: Known) -> np.ndarray:
    """The positions (P, 3) less their median difference from the projection centres that control alone gives."""
    placed, level = known.placed, VerticalityConstraint(np.array([0.0, 0.0, 1.0]), 0.0)
    sigma = np.sqrt((known.control_sigma[placed] ** 2).mean(axis=1))
    origin = known.control[placed].mean(axis=0)
    fit = fit_similarity(known.control_model[placed], known.control[placed] - origin, sigma, level)
    off = known.position - (fit.apply(model.centre) + origin)
    return known.position - (np.nanmedian(off, axis=0) if np.isfinite(off).any() else 0.0)


def _free(model: State, known: Known, origin: np.ndarray | None, approximate: tuple[float, float] | None = None) -> Datum:
    """A free network: in an upright system of its own, or that of given orientations; to scale where distances were measured, or
    nearly so where positions show it (`approximate`: the scale and its standard error in units of it)."""
    length = _scale_of_distances(known)
    # Distances are measured for the scale; positions are better than nothing.
    scale, share = (length, None) if length else (origin is None and approximate) or (None, None)
    if origin is not None:
        similarity, what = Similarity(1.0, np.eye(3), np.zeros(3)), "place, direction and scale are those of the given orientation"
    else:
        rotation, height, stands = _upright(model, known.top)
        similarity = Similarity(scale or 100.0 / max(abs(height), 1e-9), rotation, np.zeros(3))
        what = (
            "place and direction are arbitrary"
            if scale
            else ("place, direction and scale are arbitrary (the cameras are put 100 units above the ground)")
        ) + stands
    count = len(known.distances)
    scaled = f"; {count} measured distance{'s give' if count > 1 else ' gives'} the scale" if length else ""
    if share is not None:
        scaled = f"; the positions show the scale to {100 * share:.0f} %"
    return Datum(
        similarity=similarity,
        origin=np.zeros(3) if origin is None else origin,
        free=True,
        up=None,
        sentence=f"Free network: neither positions nor control define a datum; {what}{scaled}; standard errors refer to the "
        "block's own shape.",
        findings=(NoDatum(scaled=bool(scale), scale_share=share),),
        positions_aside=known.positioned,
        control_aside=known.placed,
        # Files in the project's system would put the block on another continent, in metres that are none.
        system=own_system(bool(scale)) if origin is None else None,
    )


def own_system(scaled: bool) -> str:
    """The reference system (WKT) of a block that has no place on earth, which GIS programs take for a local one."""
    scale, unit = ("in metres", "metre") if scaled else ("of arbitrary scale", NO_UNIT)
    return (
        f'ENGCRS["local system of the block, {scale}",EDATUM["block without positions and control"],CS[Cartesian,2],'
        'AXIS["x",east],AXIS["y",north],'
        f'LENGTHUNIT["{unit}",1]]'
    )


def _upright(model: State, top: np.ndarray) -> tuple[np.ndarray, float, str]:
    """A rotation (3, 3) that makes vertical what is across the plane that the photographs show, or else their mean axis; the height
    of the cameras above the ground, and what they stand on in words. `top` (P, 3) as in Known."""
    axis = mean_up(model)
    ground = model.point[np.isfinite(model.point).all(axis=1)]
    centre = model.centre.mean(axis=0)
    rows = np.einsum("pij,pi->pj", model.rotation, np.cross(top, DOWN))
    found = dominant_plane(ground, axis, rows)
    up = axis if found is None else found
    east = model.centre[-1] - model.centre[0]
    east = east - up * (east @ up)
    east = east / max(float(np.linalg.norm(east)), 1e-12)
    stands = "" if found is None else ", up is across the plane that most tie points lie near"
    return np.stack([east, np.cross(up, east), up]), float(np.median((centre - ground) @ up)), stands


def _scale_of_distances(known: Known) -> float | None:
    """The median ratio of measured to model length over all distances whose points are in the model; None without any."""
    found = []
    for first, second, length, _ in known.distances:
        model = np.linalg.norm(known.control_model[second] - known.control_model[first])
        if np.isfinite(model) and model > 0:
            found.append(length / model)
    return float(np.median(found)) if found else None


def datum_sentence(positions: int, control: int, basis: Basis | None) -> str:
    """What defines the datum: numbers of positions and control points that take part, and what the tilt about their line rests on
    (None: on them)."""
    known = []
    if control:
        known.append(f"{control} ground control point{'s' * (control > 1)}")
    if positions:
        known.append(f"{positions} GNSS position{'s' * (positions > 1)} of the projection centres")
    kind = "Control" if control >= 3 else "GNSS" if positions else "Control"
    tilt = f"; the tilt about their common line rests {BASIS[basis]}" if basis else ""
    return f"{kind}: the datum is defined by {' and '.join(known)}, each with its standard errors{tilt}."


def _findings(fit: _DatumFit, basis: Basis, vertical_sigma: float, control: np.ndarray) -> tuple[BlockFinding, ...]:
    """What is weak about the datum; `control` (n, 3) m: the control points in use."""
    found: list[BlockFinding] = []
    if fit.weak:
        total = float(np.degrees(1.0 / np.sqrt(1.0 / fit.turn**2 + 1.0 / vertical_sigma**2)))
        alone = float(np.degrees(fit.turn)) if np.isfinite(fit.turn) else None
        rests, sigma = (basis, total) if fit.held else (None, float(np.degrees(fit.turn)))
        found.append(TiltUnobserved(tilt_sigma_deg=alone, basis=rests, sigma_deg=sigma))
    if len(control) >= 3:
        spread = np.linalg.svd(control[:, :2] - control[:, :2].mean(axis=0), compute_uv=False)
        if spread[1] < ONE_SIDED * spread[0]:
            found.append(ControlOnALine())
    length = np.linalg.norm(fit.residual, axis=1)
    size = float(np.median(length / fit.sigma))
    # Both tests: precise positions exceed their standard errors wherever a free model bends, without being wrong.
    if size > MISFIT and np.median(length) > BENDS * fit.extent:
        found.append(DatumMisfit(ratio=size))
    return tuple(found)


def with_datum(network: Network, known: Known, datum: Datum, first_surveyed: int) -> Network:
    """The network with the observations and weights of the datum, in local coordinates; surveyed points are rows from
    `first_surveyed` on."""
    named = first_surveyed + np.arange(len(known.control))
    if datum.free:
        return replace(network, free=True, named=named)
    has = known.positioned
    # Positions and control set aside keep their values with weight zero: their residuals are still reported.
    usable = (has & ~datum.positions_aside)[:, None]
    centre = np.where(has[:, None], known.position - datum.origin, 0.0)
    weight = np.where(usable, 1.0 / np.where(usable, known.position_sigma, 1.0) ** 2, 0.0)
    point, point_weight = network.point.copy(), network.point_weight.copy()
    point[first_surveyed:] = np.nan_to_num(known.control - datum.origin)
    point_weight[first_surveyed:] = np.where(datum.control_aside[:, None], 0.0, 1.0 / known.control_sigma**2)
    return replace(network, centre=centre, centre_weight=weight, point=point, point_weight=point_weight, named=named)
