"""What is told of the sources of a block: offsets that were adjusted, a unit of the control, contradictions without a cause."""

from collections.abc import Iterator

import numpy as np

from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.contradiction_findings import (
    ConstantOfItsOwn,
    OffsetAdjusted,
    ScaleContradicted,
    SourcesDisagree,
    UnitContradicted,
    photographs,
)
from orthomill.schemas.findings.datum_findings import DatumMisfit
from orthomill.schemas.findings.observation_findings import (
    ControlContradicted,
    PositionContradicted,
    PositionsAlongView,
    PositionsElsewhere,
)
from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import PositionOffset, SourceStatement
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.geometry.survey_system import map_factor_at
from orthomill.tasks.orientation.block.assembly import Problem
from orthomill.tasks.orientation.block.own_constants import SMALLEST, OwnConstant
from orthomill.tasks.orientation.sources.block_sources import BlockSources
from orthomill.tasks.orientation.sources.evidence import Source
from orthomill.tasks.orientation.sources.hypotheses import Bend, Cause, PlanScale, Zoom
from orthomill.tasks.orientation.sources.source_table import Parameter, Said

SOURCES = {
    Source.PLAN: "positions in plan",
    Source.HEIGHT: "positions in height",
    Source.CONTROL: "control",
    Source.ATTITUDE: "attitudes",
    Source.MODEL: "elevation model",
    None: "given camera constant",
}
DEGREE, PERCENT = float(np.degrees(1.0)), 100.0
PARAMETERS = (
    ("shift in X", "m", 1.0),
    ("shift in Y", "m", 1.0),
    ("shift in height", "m", 1.0),
    ("tilt about X", "degrees", DEGREE),
    ("tilt about Y", "degrees", DEGREE),
    ("azimuth", "degrees", DEGREE),
    ("scale", "%", PERCENT),
)
"""Name, unit and factor into that unit of the parameters of the motion"""
CONTRADICTED = 3.0
"""Standard errors beyond which a source contradicts the others"""
PIXELS = 5.0
"""Shifts of so many pixels on the ground matter."""
MATTERS = {"degrees": 1.0, "%": 1.0}
"""Differences that matter, in the unit of the parameter"""
BEND, HEIGHT_OF = "bend", "height of"
"""Names of the bend, and how those of the heights of flights begin: other findings are made of their contradictions, which know
what matters of them"""


def source_statements(sources: BlockSources | None, problem: Problem) -> tuple[SourceStatement, ...]:
    """The table of what each source says."""
    return tuple(_statement(said, problem) for said in sources.table) if sources else ()


def _named(parameter: Parameter, problem: Problem) -> tuple[str, str, float]:
    """Name, unit and factor into that unit of a parameter."""
    if parameter.kind == "motion":
        return PARAMETERS[parameter.number]
    if parameter.kind == "camera":
        return f"camera constant of {problem.camera_names[parameter.number]}", "%", PERCENT
    if parameter.photos is None:
        return BEND, "m", 1.0
    return f"{HEIGHT_OF} {photographs([problem.names[i] for i in np.flatnonzero(parameter.photos)])}", "m", 1.0


def _statement(said: Said, problem: Problem) -> SourceStatement:
    name, unit, factor = _named(said.parameter, problem)
    known = bool(np.isfinite(said.others_sigma))
    return SourceStatement(
        source=SOURCES[said.source],
        parameter=name,
        unit=unit,
        value=factor * said.value,
        sigma=factor * said.sigma,
        others=factor * said.others if known else None,
        others_sigma=factor * said.others_sigma if known else None,
    )


def disagreements(statements: tuple[SourceStatement, ...], sources: BlockSources) -> Iterator[SourcesDisagree]:
    """The largest contradiction of every parameter that is neither chance nor too small to matter."""
    pixel, bent = sources.block.pixel, any(isinstance(cause, Bend) for cause in sources.found.causes)
    worst: dict[str, SourceStatement] = {}
    for row in statements:
        elsewhere = (row.parameter == BEND and not bent) or row.parameter.startswith(HEIGHT_OF)
        if elsewhere or row.others is None or row.others_sigma is None or row.ratio is None:
            continue
        matters = abs(row.value - row.others) > MATTERS.get(row.unit, PIXELS * pixel)
        before = worst[row.parameter].ratio if row.parameter in worst else CONTRADICTED
        if matters and row.ratio > (before or 0.0):
            worst[row.parameter] = row
    for row in worst.values():
        yield SourcesDisagree(**row.model_dump())


def own_constants(sources: BlockSources | None, names: tuple[str, ...]) -> tuple[OwnConstant, ...]:
    """Photographs that may have been taken with other camera constants than the others of their cameras."""
    found = sources.found.zooms if sources else ()
    return tuple(
        OwnConstant(tuple(names[i] for i in np.flatnonzero(zoom.photos)), 1.0 + share)
        for zoom, share in found
        if abs(share) > SMALLEST
    )


def contradicted_sources(
    sources: BlockSources | None, statements: tuple[SourceStatement, ...], control: Control, problem: Problem
) -> tuple[BlockFinding, ...]:
    """What the sources of the block as adjusted contradict each other in; `control` as it was read."""
    if sources is None:
        return ()
    units = tuple(unit_findings(sources, control))
    scales = tuple(_plan_scales(sources, control))
    return units or (*scales, *_kept_constants(sources, problem), *disagreements(statements, sources))


def _plan_scales(sources: BlockSources, control: Control) -> Iterator[ScaleContradicted]:
    """The scale of the control's map, where that explains what it says in plan."""
    for cause, place in _placed_causes(sources):
        if isinstance(cause, PlanScale):
            after, system = sources.found.after, control.read.crs if control.read else ""
            factor = 1.0 + float(after.parameters[place])
            sigma = float(np.sqrt(after.covariance[place, place]))
            yield ScaleContradicted(factor=factor, sigma=sigma, map_factor=map_factor_at(sources.site, system))


def _placed_causes(sources: BlockSources) -> Iterator[tuple[Cause, int]]:
    """The causes, and the number of the first parameter of each."""
    place = len(sources.found.after.parameters) - sum(cause.numbers for cause in sources.found.causes)
    for cause in sources.found.causes:
        yield cause, place
        place += cause.numbers


def _kept_constants(sources: BlockSources, problem: Problem) -> Iterator[ConstantOfItsOwn]:
    """Photographs that only their positions give another camera constant."""
    for cause, place in _placed_causes(sources):
        if isinstance(cause, Zoom):
            own = np.flatnonzero(cause.photos)
            camera = int(problem.camera_of[own[0]])
            constant = problem.cameras[camera].c
            yield ConstantOfItsOwn(
                photos=tuple(problem.names[i] for i in own),
                camera=problem.camera_names[camera],
                c_px=constant * (1.0 + float(sources.found.after.parameters[place])),
                others_px=constant,
                used=False,
            )


def unit_findings(sources: BlockSources, control: Control) -> Iterator[UnitContradicted]:
    """The unit in which the control fits, where that is not metres; `control` as it was read."""
    unit, block = sources.found.unit, sources.block
    if unit is None:
        return
    placed = np.isfinite(block.control).all(axis=1)
    here = block.moved(sources.found.after.motion).control[placed, 2]
    heights = [told.control[placed, 2] for told in (sources.told, sources.found.told)]
    given, fits = (float(np.median(np.abs(height - here))) for height in heights)
    median = tuple(float(np.median(height)) + sources.height_origin for height in heights)
    yield UnitContradicted(
        unit=unit.name,
        heights_only=unit.heights_only,
        given_m=given,
        fits_m=fits,
        crs=control.read.crs if control.read else "",
        heights_m=(median[0], median[1]),
    )


def offsets_of(result: Adjustment, names: tuple[str, ...], before: BlockSources) -> tuple[PositionOffset, ...]:
    """The free shifts of the positions, one by one, against those that the others have in common by their standard errors; where
    none of these is told apart, with the standard errors by which positions scatter (`before`: the sources without the offsets)."""
    network, rows = result.network, []
    columns, known = network.shift_columns, network.shift_weights > 0
    axes_of = np.array([np.nonzero(network.shift == number)[1][0] for number in range(network.shifts)], int)
    for number in np.flatnonzero(~known):
        photos, axis = network.shift[:, axes_of[number]] == number, int(axes_of[number])
        others = np.flatnonzero(known & (axes_of == axis))
        share = np.array([(network.shift == other).sum() for other in others], float)
        # What the others have in common, each flight by its photographs.
        against = np.append(1.0, -share / share.sum()) if len(others) else np.ones(1)
        own = np.append(number, others)
        sigma = float(np.sqrt(against @ result.cofactor.joint(columns[own]) @ against))
        rows.append(
            PositionOffset(
                photos=tuple(names[i] for i in np.flatnonzero(photos)),
                axis=axis,
                value=float(against @ result.state.shift[own]),
                sigma=sigma if len(others) else before.offset_sigmas(photos).get(axis, sigma),
            )
        )
    return tuple(rows)


def offset_findings(
    offsets: tuple[PositionOffset, ...], before: BlockSources, names: tuple[str, ...], heights: str | None
) -> Iterator[OffsetAdjusted]:
    """One finding for every group of positions that has offsets; `before`: the sources of the block without them."""
    motion = before.found.after.motion
    moved = float(np.linalg.norm(before.block.moved(motion).centre - before.block.centre, axis=1).max())
    positioned = {name for name, has in zip(names, before.told.positioned, strict=True) if has}
    for photos in dict.fromkeys(offset.photos for offset in offsets):
        own = {offset.axis: offset for offset in offsets if offset.photos == photos}
        own_photos = np.isin(names, photos)
        yield OffsetAdjusted(
            photos=photos,
            against="control" if positioned <= set(photos) else "others",
            offset=_by_axis({axis: offset.value for axis, offset in own.items()}),
            sigma=_by_axis({axis: offset.sigma for axis, offset in own.items()}),
            tilt_deg=float(np.degrees(np.linalg.norm(motion[3:5]))),
            moved_m=moved,
            heights=heights,
            zoom=_zoom(before, own_photos),
            stated=_stated(before, own_photos),
        )


def _stated(sources: BlockSources, photos: np.ndarray) -> tuple[float, float, float] | None:
    """The stated standard errors of the positions of `photos` (P,) bool, m."""
    sigma = sources.told.position_sigma[photos & sources.told.positioned]
    if not len(sigma):
        return None
    x, y, z = map(float, np.median(sigma, axis=0))
    return x, y, z


def _zoom(sources: BlockSources, photos: np.ndarray) -> float | None:
    """The factor of another camera constant of `photos` (P,) bool that would explain their offset."""
    same = (share for zoom, share in sources.found.zooms if (zoom.photos == photos).all() and abs(share) > SMALLEST)
    return next((1.0 + share for share in same), None)


def _by_axis(values: dict[int, float]) -> tuple[float | None, float | None, float | None]:
    return values.get(0), values.get(1), values.get(2)


def covered_by(findings: tuple[BlockFinding, ...]) -> tuple[type, ...]:
    """The kinds of findings that only describe what one of `findings` names the cause of."""
    if any(isinstance(finding, UnitContradicted) for finding in findings):
        # In another unit every control point looks wrong, and the right ones most.
        return DatumMisfit, PositionsElsewhere, PositionsAlongView, ControlContradicted, PositionContradicted
    offset = any(isinstance(finding, OffsetAdjusted) for finding in findings)
    return (DatumMisfit, PositionsElsewhere, PositionsAlongView) if offset else ()
