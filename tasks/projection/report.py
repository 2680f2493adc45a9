"""The report on the projections: what the mesh was worth, what each output shows, how many photographs see it, and the proof."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import AnyFrame, FlatFrame, ViewFrame
from orthomill.schemas.stage_report import Answer, Figure, Grid, Picture, Product, StageReport, Topic, Verdict
from orthomill.tasks.imagery.radiometric_balance import Radiometry
from orthomill.tasks.projection.facing import MeshFacing
from orthomill.tasks.projection.leave_one_out import LeftOutPhotograph
from orthomill.tasks.projection.model.model_colours import TileFacts
from orthomill.tasks.projection.model.model_words import model_products, texture_figures
from orthomill.tasks.projection.projection_colours import NO_SURFACE, ProjectionTile
from orthomill.tasks.projection.widening.hidden_edges import NO_ZONE, ChosenWidth
from orthomill.tasks.visibility.sight import PlaceSight

COVERAGE_CLASSES: tuple[tuple[int, str, str], ...] = (
    (0, "#d7191c", "seen by no photograph"),
    (1, "#1a9641", "seen by one"),
    (2, "#2b5fd9", "seen by two"),
    *((count, "#9a9a9a", "seen by three or more") for count in range(3, 65)),
    (NO_SURFACE, "#ffffff", "no surface"),
)
"""Red 0, green 1, blue 2, grey 3 or more photographs (Petsa et al. 2007, Fig. 22)."""
PICTURED = 6
"""photographs whose depths the report shows"""
_ROUGH = 1.25
"""gradient energy from which a picture shows more than the photograph itself: finer photographs, or wrong edges"""
_UNRELATED, _SMALL = 14.0, 0.02
"""dB of photographs made again from the others below which they show different things; part of the photographs that is too little
for a surface that they were taken of"""
_FILLED, _SHARP, _BACKS, _UNLIKE, _BEHIND, _FEW = 0.9, 0.9, 0.2, 1.5, 0.5, 4
"""Part of the surface that a good output colours; gradient energy of a sharp blend; part of backs that is worth a warning; a
photograph whose difference is so many times the median disagrees with the block; part of an output that shows backs; triangles
that are too few for a surface"""


@dataclass(frozen=True)
class OutputFacts:
    """An output, its number of tiles, and the side of its pixel on the surface, m."""

    frame: AnyFrame
    tiles: int
    pixel: float


@dataclass(frozen=True, eq=False)
class _OutputTotals:
    """Sums over the tiles of an output."""

    facts: OutputFacts
    tiles: tuple[ProjectionTile, ...]

    def sum(self, field: str) -> float:
        """Of a number of the tiles."""
        return sum(getattr(tile, field) for tile in self.tiles)

    @property
    def name(self) -> str:
        return self.facts.frame.name

    @property
    def seen(self) -> tuple[int, ...]:
        """Pixels that 0, 1, 2, 3 or more photographs see."""
        return tuple(sum(tile.seen[k] for tile in self.tiles) for k in range(4))

    @property
    def coloured(self) -> float:
        """Part of the surface that has a colour."""
        return self.sum("coloured") / max(self.sum("surface"), 1)

    @property
    def difference(self) -> float | None:
        """Mean difference of the blended colours from their mean, grey levels."""
        return self.sum("difference_sum") / self.sum("difference_count") if self.sum("difference_count") else None


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
        totals.append(_OutputTotals(facts, statistics[start : start + facts.tiles]))
        start += facts.tiles
    compared = tuple(one for one in left_out if one.blended is not None)
    losses = (*_empty_warnings(census, totals), *_mesh_warnings(census), *_strange_warnings(facing, compared))
    losses += (*_unlike_warnings(compared), *_hole_warnings(facing))
    return StageReport(
        verdict=_verdict(totals, compared),
        answers=tuple(_answers(census, totals)),
        products=(*_products(totals), *(model_products(whole_model) if textures else ())),
        figures=(*_figures(census, totals, radiometry, compared, widening), *(texture_figures(textures) if textures else ())),
        grids=(*_grids(totals, facing, left_out), *_width_grid(widening)),
        pictures=(*_pictures(totals, left_out, proofs), *_depths(pictured)),
        warnings=(*losses, *_notes(census, facing)),
        losses=losses,
    )


def _answers(census: MeshCensus, totals: list[_OutputTotals]) -> Iterator[Answer]:
    pixels = sorted({frame.pixel for total in totals if not isinstance(frame := total.facts.frame, ViewFrame)})
    if pixels:
        sides = " and ".join(f"{1000 * pixel:g} mm" for pixel in pixels)
        yield Answer(topic=Topic.GROUND_PIXEL, text=f"{sides} on the surface")
    yield Answer(topic=Topic.AREA, text=f"{census.size:.3g} m across, {census.triangles} triangles")
    yield Answer(topic=Topic.HEIGHTS, text="of the surface that was given; not measured from the photographs")
    yield Answer(topic=Topic.ORTHOIMAGE, text="; ".join(map(_described, totals)) + ".")


def _described(total: _OutputTotals) -> str:
    frame = total.facts.frame
    size = f"{frame.cols} x {frame.rows} px"
    return f"{total.name}: {size}" if isinstance(frame, ViewFrame) else f"{total.name}: {size} of {1000 * frame.pixel:g} mm"


def _verdict(totals: list[_OutputTotals], compared: tuple[LeftOutPhotograph, ...]) -> Verdict:
    worst = min(totals, key=lambda total: total.coloured)
    text = f"{100 * worst.coloured:.1f} % of the surface in '{worst.name}' has a colour"
    energy = _median([one.blended.gradient for one in compared if one.blended])
    if energy is not None:
        text += f"; photographs made again from the others are {_sharpness(energy)}"
    good = worst.coloured >= _FILLED and (energy is None or energy >= _SHARP)
    poor = worst.coloured <= 0.5 or _unrelated(compared)
    return Verdict(level="poor" if poor else "good" if good else "fair", sentence=text + ".", weighs=True)


def _sharpness(energy: float) -> str:
    """What a share of the gradient energy of photographs means, in plain words."""
    # The energy goes with the square of the differences, which are what one sees.
    contrast = f"{100 * np.sqrt(energy):.0f} % of the contrast between neighbouring pixels"
    if energy > _ROUGH:
        return f"rougher than they were taken, with {contrast}: others show more, or edges of the surface are wrong"
    return "as sharp as they were taken" if energy >= _SHARP else f"blurred: {contrast} is left"


def _unrelated(compared: tuple[LeftOutPhotograph, ...]) -> bool:
    """Whether the photographs show different things on the surface."""
    psnr = _median([one.blended.psnr for one in compared if one.blended])
    return psnr is not None and psnr < _UNRELATED


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def _called(total: _OutputTotals) -> str:
    return f"{'True orthoimage' if isinstance(total.facts.frame, FlatFrame) else 'Picture'} '{total.name}'"


def _products(totals: list[_OutputTotals]) -> Iterator[Product]:
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
    totals: list[_OutputTotals],
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
    yield Figure(
        name="brightness_difference",
        value=radiometry.difference_after,
        unit="grey levels",
        sentence="Mean difference of two photographs at the same place after the balance.",
    )
    for kind in ("blended", "nearest"):
        for measure, unit in (("psnr", "dB"), ("ssim", ""), ("gradient", "")):
            value = _median([getattr(getattr(one, kind), measure) for one in compared])
            sentence = f"Median {_MEASURES[measure]} of photographs made again from the others, {_KINDS[kind]}."
            yield Figure(name=f"left_out_{kind}_{measure}", value=_rounded(value), unit=unit, sentence=sentence)


_MEASURES = {
    "psnr": "likeness (PSNR)",
    "ssim": "likeness of structure (SSIM, 1 is the same)",
    "gradient": "sharpness (gradient energy over that of the photograph)",
}
_KINDS = {"blended": "blended", "nearest": "each place from its nearest photograph alone"}


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _output_figures(total: _OutputTotals) -> Iterator[Figure]:
    surface, values = max(total.sum("surface"), 1), max(total.sum("values"), 1)
    name = total.name
    yield Figure(
        name=f"{name}_coloured", value=round(100 * total.coloured, 2), unit="%", sentence="Surface with a colour.", headline=True
    )
    for count, pixels in zip(("no", "one", "two", "three_or_more"), total.seen, strict=True):
        yield Figure(
            name=f"{name}_seen_by_{count}",
            value=round(100 * pixels / surface, 2),
            unit="%",
            sentence=f"Surface that {count.replace('_', ' ')} photographs see.",
        )
    yield Figure(name=f"{name}_pixel", value=total.facts.pixel, unit="m", sentence="Side of a pixel on the surface.")
    rejected, zone = 100 * total.sum("rejected") / values, 100 * total.sum("zone") / values
    yield Figure(name=f"{name}_rejected", value=round(rejected, 2), unit="%", sentence="Colours rejected as gross errors.")
    yield Figure(name=f"{name}_zone", value=round(zone, 2), unit="%", sentence="Colours next to the limit of what is hidden.")
    yield Figure(
        name=f"{name}_difference",
        value=_rounded(total.difference),
        unit="grey levels",
        sentence="Mean difference of the blended colours from their mean.",
    )


def _grids(totals: list[_OutputTotals], facing: MeshFacing, left_out: tuple[LeftOutPhotograph, ...]) -> Iterator[Grid]:
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


def _sight_grid(total: _OutputTotals, facing: MeshFacing) -> Grid:
    shares: Counter[str] = Counter()
    sights: dict[str, np.ndarray] = {}
    for tile in total.tiles:
        shares.update(tile.shares)
        for name, counts in tile.sights.items():
            sights[name] = sights.get(name, np.zeros(len(counts), np.int64)) + np.array(counts)
    coloured, backs = max(total.sum("coloured"), 1), {one.photo: one.backs for one in facing.photos}
    rows = tuple(
        (
            name,
            round(100 * shares[name] / coloured, 2),
            int(counts[PlaceSight.SEEN] + counts[PlaceSight.AT_BREAK]),
            int(counts[PlaceSight.HIDDEN]),
            int(counts[PlaceSight.AWAY]),
            int(counts[PlaceSight.MASKED]),
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

    return (one.photo, round(100 * one.covered, 1), *three("blended"), *three("nearest"), _rounded(one.difference))


def _pictures(totals: list[_OutputTotals], left_out: tuple[LeftOutPhotograph, ...], proofs: tuple[str, ...]) -> Iterator[Picture]:
    # What can be measured in comes first; pictures lead only where there is nothing else.
    flat = [total for total in totals if isinstance(total.facts.frame, FlatFrame)]
    for total in totals:
        place = f"projection/{total.name}"
        yield Picture(title=_called(total), raster=f"{place}/ortho", style="rgb", first_page=total in (flat or totals))
        yield Picture(
            title=f"Coverage of '{total.name}'",
            raster=f"{place}/coverage",
            style="classes",
            classes=COVERAGE_CLASSES,
            caption="How many photographs see each pixel.",
        )
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


def _mesh_warnings(census: MeshCensus) -> Iterator[str]:
    """What the mesh is, where it is not what one expects."""
    if census.triangles < _FEW:
        count = "one triangle" if census.triangles == 1 else f"{census.triangles} triangles"
        yield f"The surface has {count} only, {census.size:.4g} m large: is it the right file?"
    if census.triangulated:
        yield (
            f"The file of the surface has no triangles: its {census.vertices} points were joined in the plane that fits them best, "
            "with one depth at each place. Overhangs need a mesh."
        )
    if census.turned_edges:
        yield (
            f"{census.turned_edges} edges of the mesh lie between triangles that face opposite ways: parts of it are inside out "
            "and stay without colour. Let the program that made it orient its faces."
        )


def _depths(pictured: tuple[str, ...]) -> Iterator[Picture]:
    for name in pictured:
        yield Picture(
            title=f"Depth of {name}",
            raster=f"projection/photographs/{name}/picture",
            style="rgb",
            caption="Distance of the surface, near is bright; all of them are in products/depth.",
        )


def _hole_warnings(facing: MeshFacing) -> Iterator[str]:
    """Photographs that see the inside of the mesh."""
    backs = [one.photo for one in facing.photos if one.backs > _BACKS * max(one.fronts + one.backs, 1e-9)]
    if backs:
        yield (
            f"{', '.join(backs[:6])} look at the backs of triangles: the mesh has holes there, and nothing behind them is "
            "coloured. Close the holes, or leave these photographs out where they disturb."
        )


def _empty_warnings(census: MeshCensus, totals: list[_OutputTotals]) -> Iterator[str]:
    """Outputs that show little of the surface."""
    for total in totals:
        if total.sum("surface") == 0:
            yield (
                f"'{total.name}' shows no surface: its plane, view or section leaves nothing; move it, or look at the coordinates "
                f"of the mesh ({', '.join(f'{value:.6g}' for value in census.low)} to "
                f"{', '.join(f'{value:.6g}' for value in census.high)})."
            )
        elif total.sum("backs") > _BEHIND * total.sum("surface"):
            part = 100 * total.sum("backs") / total.sum("surface")
            yield (
                f"{part:.0f} % of the surface in '{total.name}' shows its back, which nothing is painted on: it is seen from "
                "inside or from behind. Move the position or turn the plane round."
            )
        elif total.coloured < 0.5:
            yield (
                f"Only {100 * total.coloured:.0f} % of the surface in '{total.name}' is seen by a photograph; the rest stays "
                "empty. Photographs from more sides would fill it."
            )


def _strange_warnings(facing: MeshFacing, compared: tuple[LeftOutPhotograph, ...]) -> Iterator[str]:
    """A surface that the photographs were hardly taken of."""
    largest = max((one.fronts + one.backs for one in facing.photos), default=1.0)
    if _unrelated(compared):
        yield (
            "Made again from the others, the photographs are unlike themselves throughout: on this surface they show different "
            "things. The unit of the surface or its place is wrong, or it belongs to another orientation."
        )
    if largest < _SMALL:
        yield (
            f"The surface fills {100 * largest:.1f} % of a photograph at most: is its unit the right one, and is it what was "
            "photographed?"
        )


def _unlike_warnings(compared: tuple[LeftOutPhotograph, ...]) -> Iterator[str]:
    """Photographs that are unlike what the others show of the same places."""
    differences = [one.difference for one in compared if one.difference is not None]
    usual = float(np.median(differences)) if len(differences) > 2 else np.inf
    for one in compared:
        if one.difference is not None and one.difference > _UNLIKE * usual:
            yield (
                f"{one.photo} disagrees with the others: it differs by {one.difference:.1f} grey levels where {usual:.1f} are "
                "usual. Its orientation or its brightness is wrong, or something moved; look at its picture below."
            )


def _notes(census: MeshCensus, facing: MeshFacing) -> Iterator[str]:
    """What was done about the mesh, which costs nothing."""
    if facing.turned:
        yield "The triangles of the mesh face inwards: it was turned, because the photographs see more of their backs than fronts."
    mended = census.not_finite + census.degenerate + census.duplicate
    if mended:
        yield (
            f"{mended} of {census.read} triangles of the mesh were left out: {census.not_finite} not finite, {census.degenerate} "
            f"without area, {census.duplicate} twice."
        )
