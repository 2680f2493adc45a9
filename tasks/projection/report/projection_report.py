"""The report on the projections: what the mesh was worth, what each output shows, how many photographs see it, and the proof."""

from collections import Counter
from collections.abc import Iterator
from math import sqrt

from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import FlatFrame, ViewFrame
from orthomill.schemas.stage_report import Answer, Figure, Grid, Picture, Product, StageReport, Topic, Verdict
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.report.colour_words import (
    balance_figure,
    coverage_classes,
    coverage_picture,
    difference_figure,
    percent,
    rejected_figure,
    rounded,
    seen_figures,
)
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.colouring.widening.hidden_edges import NO_ZONE, ChosenWidth
from orthomill.tasks.projection.model.model_colours import TileFacts
from orthomill.tasks.projection.photographs.leave_one_out import LeftOutPhotograph
from orthomill.tasks.projection.report.model_words import model_products, texture_figures
from orthomill.tasks.projection.report.output_doubts import output_doubts
from orthomill.tasks.projection.report.output_totals import OutputFacts, OutputTotals
from orthomill.tasks.projection.report.surface_doubts import (
    FEW,
    hole_doubts,
    mended,
    mesh_doubts,
    strange_doubts,
    unlike_doubts,
    unrelated,
    usual,
)
from orthomill.tasks.projection.tiles.output_colours import NO_SURFACE, ProjectionTile
from orthomill.tasks.visibility.sight import PlaceSight

_COUNTS = ("no", "one", "two", "three_or_more")
PICTURED = 6
"""photographs whose depths the report shows"""
_ROUGH = 1.25
"""gradient energy from which a picture shows more than the photograph itself: finer photographs, or wrong edges"""
_FILLED, _SHARP = 0.9, 0.9
"""part of the surface that a good output colours; gradient energy of a sharp blend"""


def projection_report(
    census: MeshCensus,
    facing: MeshFacing,
    radiometry: Radiometry,
    statistics: tuple[ProjectionTile, ...],
    left_out: tuple[LeftOutPhotograph, ...],
    textures: tuple[TileFacts, ...],
    outputs: tuple[OutputFacts, ...],
    proofs: tuple[str, ...],
    pictured: tuple[str, ...],
    whole_model: bool,
    widening: ChosenWidth = NO_ZONE,
) -> StageReport:
    """The report of the stage. statistics: tiles of all outputs, in their order; textures: of the model's tiles, if there is one;
    proofs: rasters of `left_out`; pictured: photographs whose depths are shown; whole_model: whether one GLB holds all tiles;
    widening: how wide the zone next to the limits of what is hidden is."""
    totals, start = [], 0
    for facts in outputs:
        totals.append(OutputTotals(facts, statistics[start : start + facts.tiles]))
        start += facts.tiles
    compared = tuple(one for one in left_out if one.blended is not None)
    losses = (*output_doubts(census, totals), *mesh_doubts(census), *strange_doubts(facing, compared))
    losses += (*unlike_doubts(compared), *hole_doubts(facing))
    return StageReport(
        verdict=_verdict(census, totals, compared),
        answers=tuple(_answers(census, totals)),
        products=(*_products(totals), *(model_products(whole_model) if textures else ())),
        figures=(*_figures(census, totals, radiometry, compared, widening), *(texture_figures(textures) if textures else ())),
        grids=(*_grids(totals, facing, left_out), *_width_grid(widening)),
        pictures=(*_pictures(totals, left_out, proofs), *_depths(pictured)),
        warnings=(*losses, *mended(census, facing)),
        losses=losses,
    )


def _answers(census: MeshCensus, totals: list[OutputTotals]) -> Iterator[Answer]:
    pixels = sorted({frame.pixel for total in totals if not isinstance(frame := total.facts.frame, ViewFrame)})
    if pixels:
        sides = " and ".join(f"{1000 * pixel:g} mm" for pixel in pixels)
        yield Answer(topic=Topic.GROUND_PIXEL, text=f"{sides} on the surface")
    yield Answer(topic=Topic.AREA, text=f"{census.size:.3g} m across, {census.triangles} triangles")
    yield Answer(topic=Topic.HEIGHTS, text="of the surface that was given; not measured from the photographs")
    yield Answer(topic=Topic.ORTHOIMAGE, text="; ".join(map(_described, totals)) + ".")


def _described(total: OutputTotals) -> str:
    frame = total.facts.frame
    size = f"{frame.cols} x {frame.rows} px"
    return f"{total.name}: {size}" if isinstance(frame, ViewFrame) else f"{total.name}: {size} of {1000 * frame.pixel:g} mm"


def _verdict(census: MeshCensus, totals: list[OutputTotals], compared: tuple[LeftOutPhotograph, ...]) -> Verdict:
    # The holes of single photographs are no fault: they were asked for.
    blended = [total for total in totals if not total.facts.only] or totals
    worst = min(blended, key=lambda total: total.coloured)
    text = f"{100 * worst.coloured:.1f} % of the surface in '{worst.name}' has a colour"
    energy = usual([one.blended.gradient for one in compared if one.blended])
    if energy is not None:
        text += f"; photographs made again from the others are {_sharpness(energy)}"
    good = worst.coloured >= _FILLED and (energy is None or energy >= _SHARP) and census.triangles >= FEW
    poor = worst.coloured <= 0.5 or unrelated(compared)
    return Verdict(level="poor" if poor else "good" if good else "fair", sentence=text + ".", weighs=True)


def _sharpness(energy: float) -> str:
    """What a share of the gradient energy of photographs means, in plain words."""
    # The energy goes with the square of the differences, which are what one sees.
    contrast = f"{100 * sqrt(energy):.0f} % of the contrast between neighbouring pixels"
    if energy > _ROUGH:
        return f"rougher than they were taken, with {contrast}: others show more, or edges of the surface are wrong"
    return "as sharp as they were taken" if energy >= _SHARP else f"blurred: {contrast} is left"


def _called(total: OutputTotals) -> str:
    return f"{'True orthoimage' if isinstance(total.facts.frame, FlatFrame) else 'Picture'} '{total.name}'"


def _products(totals: list[OutputTotals]) -> Iterator[Product]:
    for total in totals:
        path = f"products/{total.name}.{'tif' if isinstance(total.facts.frame, FlatFrame) else 'png'}"
        yield Product(path=path, purpose=f"{_called(total)} of the surface", main=True)
    yield Product(path="products/projections.json", purpose="Where the planes, cylinders and views of the outputs lie")


def _width_grid(widening: ChosenWidth) -> Iterator[Grid]:
    """The widths that were tried."""
    if widening.tried:
        rows = ((one.width, round(one.difference, 3), "used" if one.width == widening.width else "") for one in widening.tried)
        yield Grid(
            title="Width of the zone next to the limits of what is hidden",
            columns=("width px", "difference from photographs that took no part", "used"),
            rows=tuple(rows),
            note=f"Grey levels at {widening.places} places. Where no width is better than none by more than chance none is used.",
        )


def _figures(
    census: MeshCensus,
    totals: list[OutputTotals],
    radiometry: Radiometry,
    compared: tuple[LeftOutPhotograph, ...],
    widening: ChosenWidth,
) -> Iterator[Figure]:
    yield Figure(name="triangles", value=census.triangles, sentence="Triangles of the mesh that are used.", headline=True)
    yield Figure(
        name="surface_system",
        value=census.system or "that of the project",
        sentence="Reference system of the surface's file; metres and the project's system from here on.",
        detail=True,
    )
    yield Figure(name="bodies", value=census.bodies, sentence="Separate bodies of the mesh.")
    for name, sentence in (
        ("not_finite", "Triangles left out because a coordinate is not finite."),
        ("degenerate", "Triangles left out because their corners are on a line."),
        ("duplicate", "Triangles left out because another one has the same corners."),
        ("open_edges", "Edges of one triangle only: rims of the surface and of its holes."),
    ):
        yield Figure(name=name, value=getattr(census, name), sentence=sentence, detail=True)
    for total in totals:
        yield from _output_figures(total)
    yield Figure(
        name="widening",
        value=widening.width,
        unit="px",
        sentence="Next to the limit of what it does not see a photograph's colours serve only where there are no others.",
        detail=True,
    )
    yield balance_figure("brightness_difference", radiometry.difference_after)
    for kind in ("blended", "nearest"):
        for measure, unit in (("psnr", "dB"), ("ssim", ""), ("gradient", "")):
            value = usual([getattr(getattr(one, kind), measure) for one in compared])
            sentence = f"Median {_MEASURES[measure]} of photographs made again from the others, {_KINDS[kind]}."
            yield Figure(name=f"left_out_{kind}_{measure}", value=rounded(value, 4), unit=unit, sentence=sentence)


_MEASURES = {
    "psnr": "likeness (PSNR)",
    "ssim": "likeness of structure (SSIM, 1 is the same)",
    "gradient": "sharpness (gradient energy over that of the photograph)",
}
_KINDS = {"blended": "blended", "nearest": "each place from its nearest photograph alone"}


def _output_figures(total: OutputTotals) -> Iterator[Figure]:
    name, values = total.name, total.colours.values
    yield Figure(
        name=f"{name}_coloured", value=round(100 * total.coloured, 2), unit="%", sentence="Surface with a colour.", headline=True
    )
    yield from seen_figures([f"{name}_seen_by_{count}" for count in _COUNTS], total.colours, total.sum("surface"), 2, of="Surface")
    yield Figure(name=f"{name}_pixel", value=total.facts.pixel, unit="m", sentence="Side of a pixel on the surface.")
    yield rejected_figure(f"{name}_rejected", total.colours, 2)
    zone = percent(total.sum("zone"), values, 2)
    yield Figure(name=f"{name}_zone", value=zone, unit="%", sentence="Colours next to the limit of what is hidden.")
    yield difference_figure(f"{name}_difference", total.colours, 4)


def _grids(totals: list[OutputTotals], facing: MeshFacing, left_out: tuple[LeftOutPhotograph, ...]) -> Iterator[Grid]:
    for total in totals:
        yield _sight_grid(total, facing)
    if left_out:
        rows = tuple(_left_out_row(one) for one in left_out)
        columns = (
            "photograph",
            "covered %",
            "PSNR dB",
            "SSIM",
            "gradient %",
            "nearest: PSNR dB",
            "SSIM ",
            "gradient % ",
            "difference",
        )
        note = (
            "Each photograph made again from all others; 'nearest' is what one photograph for each place gives. Gradient: "
            "sharpness, the squared differences between neighbours over those of the photograph itself; below 90 % it is blurred."
        )
        yield Grid(title="Photographs from the others", columns=columns, rows=rows, note=note)


def _sight_grid(total: OutputTotals, facing: MeshFacing) -> Grid:
    sights: dict[str, Counter[PlaceSight]] = {}
    for tile in total.tiles:
        for name, counts in tile.sights.items():
            sights.setdefault(name, Counter()).update(dict(zip(PlaceSight, counts, strict=True)))
    shares = total.colours.shares
    coloured, backs = max(total.sum("coloured"), 1), {one.photo: one.backs for one in facing.photos}
    rows = tuple(
        (
            name,
            round(100 * shares.get(name, 0.0) / coloured, 2),
            counts[PlaceSight.SEEN] + counts[PlaceSight.AT_BREAK],
            counts[PlaceSight.HIDDEN],
            counts[PlaceSight.AWAY],
            counts[PlaceSight.MASKED],
            round(100 * backs.get(name, 0.0), 2),
        )
        for name, counts in sights.items()
    )
    columns = ("photograph", "part of the picture %", "seen px", "hidden px", "facing away px", "masked px", "backs in it %")
    return Grid(title=f"Photographs in '{total.name}'", columns=columns, rows=rows)


def _left_out_row(one: LeftOutPhotograph) -> tuple[float | str | None, ...]:
    def three(kind: str) -> tuple[float | None, ...]:
        found = getattr(one, kind)
        return (round(found.psnr, 2), round(found.ssim, 4), round(100 * found.gradient, 1)) if found else (None, None, None)

    return (one.photo, round(100 * one.covered, 1), *three("blended"), *three("nearest"), rounded(one.difference, 4))


def _pictures(totals: list[OutputTotals], left_out: tuple[LeftOutPhotograph, ...], proofs: tuple[str, ...]) -> Iterator[Picture]:
    # What can be measured in comes first; pictures lead only where there is nothing else.
    most = max((len(tile.sights) for total in totals for tile in total.tiles), default=0)
    classes = (*coverage_classes(min(most, NO_SURFACE - 1)), (NO_SURFACE, "#ffffff", "no surface"))
    flat = [total for total in totals if isinstance(total.facts.frame, FlatFrame)]
    for total in totals:
        place = f"projection/{total.name}"
        yield Picture(title=_called(total), raster=f"{place}/ortho", style="rgb", first_page=total in (flat or totals))
        yield coverage_picture(f"Coverage of '{total.name}'", f"{place}/coverage", classes)
        yield Picture(title=f"Depth of '{total.name}'", raster=f"{place}/nearness", style="ramp", colours="gray", unit="m")
    for one, raster in zip(left_out, proofs, strict=True):
        yield Picture(
            title=f"Difference of {one.photo} from the others",
            raster=f"projection/{raster}/difference",
            style="ramp",
            colours="magma",
            low=0.0,
            high=60.0,
            unit="grey levels",
        )


def _depths(pictured: tuple[str, ...]) -> Iterator[Picture]:
    for name in pictured:
        yield Picture(
            title=f"Depth of {name}",
            raster=f"projection/photographs/{name}/picture",
            style="rgb",
            caption="Distance of the surface, near is bright; all of them are in products/depth.",
        )
