"""What the stage `texture` tells people: how much is seen by how many photos, what each photo gave, and how well they agree."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.schemas.surface import ORTHO
from orthomill.tasks.texture.mosaic import TileTexture
from orthomill.tasks.texture.radiometric_balance import Radiometry

COVERAGE = "texture/coverage"
"""uint8: number of photographs that see the pixel; 0 also where there is no height"""
REJECTED = "texture/rejected"
"""uint8: number of colours rejected at the pixel"""
HEIGHT_SOURCE = "texture/height_source"
"""uint8: 0 no height, 1 measured, 2 interpolated for draping only"""

COVERAGE_COLOURS = ("#d7191c", "#1a9641", "#2b5fd9", "#9a9a9a")
"""Red 0, green 1, blue 2, grey 3 or more photos (Petsa et al. 2007, fig. 22)."""


@dataclass(frozen=True)
class TextureFacts:
    """What planning knew."""

    cell: float
    dsm_cell: float
    ground_pixel: float
    heights: str


def coverage_classes(most: int) -> tuple[tuple[int, str, str], ...]:
    """Code, colour and meaning of every count up to `most`; counts of three or more share the grey."""
    names = ("seen by no photo", "seen by one photo", "seen by two photos")
    return tuple(
        (count, COVERAGE_COLOURS[min(count, 3)], names[count] if count < 3 else f"seen by {count} photos")
        for count in range(max(most, 3) + 1)
    )


def _total(statistics: tuple[TileTexture, ...], field: str) -> float:
    return sum(getattr(tile, field) for tile in statistics)


def _share(part: float, whole: float) -> float:
    return round(100.0 * part / whole, 3) if whole else 0.0


def _figures(statistics: tuple[TileTexture, ...], radiometry: Radiometry, facts: TextureFacts) -> tuple[Figure, ...]:
    pixels = _total(statistics, "pixels")
    seen = np.sum([tile.seen for tile in statistics], axis=0)
    values, rejected = _total(statistics, "values"), _total(statistics, "rejected")
    count = _total(statistics, "difference_count")
    with_height = pixels - _total(statistics, "no_height")
    residual = _total(statistics, "difference_sum") / count if count else None
    return (
        Figure(name="cell", value=facts.cell, unit="m", sentence="Pixel of the orthoimage on the ground."),
        Figure(
            name="photo_ground_pixel",
            value=round(facts.ground_pixel, 4),
            unit="m",
            sentence="Pixel of the photos on the ground, median.",
        ),
        Figure(name="pixels", value=int(pixels), sentence="Pixels of the orthoimage."),
        Figure(name="height_share", value=_share(with_height, pixels), unit="%", sentence="Pixels that have a height."),
        Figure(
            name="draped_share",
            value=_share(_total(statistics, "draped"), pixels),
            unit="%",
            sentence="Pixels whose height was interpolated for the texture only.",
        ),
        *(
            Figure(name=f"seen_by_{name}", value=_share(seen[i], pixels), unit="%", sentence=f"Pixels seen by {words}.")
            for i, (name, words) in enumerate(
                (
                    ("0", "no photo, or without height"),
                    ("1", "one photo"),
                    ("2", "two photos"),
                    ("3_or_more", "three photos or more"),
                )
            )
        ),
        Figure(
            name="hidden_share",
            value=_share(with_height - (pixels - seen[0]), with_height),
            unit="%",
            sentence="Pixels with a height that no photo sees: outside all photos, or hidden.",
        ),
        Figure(
            name="rejected_share",
            value=_share(rejected, values),
            unit="%",
            sentence="Colours rejected as gross errors, of all colours.",
        ),
        Figure(
            name="seam_difference",
            value=None if residual is None else round(residual, 3),
            unit="grey levels",
            sentence="Mean absolute difference of the blended colours from their blend, after balance and rejection.",
        ),
        Figure(
            name="balance_difference_before",
            value=_rounded(radiometry.difference_before),
            unit="grey levels",
            sentence="Mean absolute difference of two photos at the same ground before the radiometric balance.",
        ),
        Figure(
            name="balance_difference_after",
            value=_rounded(radiometry.difference_after),
            unit="grey levels",
            sentence="The same after it.",
        ),
        Figure(
            name="balance_difference_median_after",
            value=_rounded(radiometry.difference_median_after),
            unit="grey levels",
            sentence="Its median: free of vehicles and mismatches.",
        ),
        Figure(name="balance_samples", value=radiometry.points, sentence="Ground samples that carried the balance."),
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _photo_grid(statistics: tuple[TileTexture, ...], radiometry: Radiometry) -> Grid:
    seen, share = {}, {}
    for tile in statistics:
        for name, count in tile.photo_seen.items():
            seen[name] = seen.get(name, 0) + count
            share[name] = share.get(name, 0.0) + tile.photo_share[name]
    whole = sum(share.values())
    rows = tuple(
        (
            photo.photo,
            seen.get(photo.photo, 0),
            _share(share.get(photo.photo, 0.0), whole),
            *(round(g, 4) for g in photo.gain),
            *(round(o, 2) for o in photo.offset),
            round(float(np.mean(photo.v1) + np.mean(photo.v2)), 4),
            photo.samples,
        )
        for photo in radiometry.photos
    )
    columns = (
        "photo",
        "pixels seen",
        "part of the orthoimage %",
        "gain 1",
        "gain 2",
        "gain 3",
        "offset 1",
        "offset 2",
        "offset 3",
        "falloff at the corner",
        "samples",
    )
    return Grid(
        title="What each photo gave",
        columns=columns,
        rows=rows,
        note="Gains and offsets are relative to the block's mean; the falloff is the share of light lost (negative) at "
        "the corners.",
    )


def _warnings(statistics: tuple[TileTexture, ...], radiometry: Radiometry) -> tuple[str, ...]:
    pixels = _total(statistics, "pixels")
    seen = np.sum([tile.seen for tile in statistics], axis=0)
    hidden = pixels - _total(statistics, "no_height") - (pixels - seen[0])
    values, rejected = _total(statistics, "values"), _total(statistics, "rejected")
    idle = [photo.photo for photo in radiometry.photos if not any(tile.photo_seen.get(photo.photo) for tile in statistics)]
    warnings = []
    if seen[0] == pixels:
        warnings.append("The orthoimage is empty: no photo sees any ground that has a height. Look at the surface model first.")
    if hidden > 0.05 * pixels:
        warnings.append(
            f"{_share(hidden, pixels):.1f} % of the orthoimage has a height but is seen by no photo (outside all of "
            "them, or hidden by what stands in the way); it stays transparent. More photos would fill it."
        )
    if values and rejected > 0.25 * values:
        warnings.append(
            f"{_share(rejected, values):.0f} % of all colours were rejected: heights or orientation may be wrong, "
            "or the photos differ in more than brightness."
        )
    if len(radiometry.photos) > 1 and not radiometry.points:
        warnings.append("The photos were not brought to one brightness: no ground was seen by two of them, or balance is none.")
    if radiometry.difference_median_after is not None and radiometry.difference_median_after > 10.0:
        warnings.append(
            f"After the radiometric balance the photos still differ by {radiometry.difference_median_after:.0f} grey "
            "levels (median): seams may show."
        )
    if idle:
        warnings.append(f"No ground of the orthoimage is seen by: {', '.join(idle)}.")
    return tuple(warnings)


def _pictures(most: int) -> tuple[Picture, ...]:
    return (
        Picture(
            title="True orthoimage",
            raster=ORTHO,
            style="rgb",
            caption="Blended from all photos that see the ground; transparent where none does.",
        ),
        Picture(
            title="Coverage",
            raster=COVERAGE,
            style="classes",
            classes=coverage_classes(most),
            caption="How many photos see each pixel: more photos are needed where it is red.",
        ),
        Picture(
            title="Rejected colours",
            raster=REJECTED,
            style="classes",
            caption="Vehicles, people, leaves, and places where heights are wrong.",
            classes=(
                (0, "#ffffff", "none"),
                (1, "#fdae61", "one"),
                (2, "#d7191c", "two"),
                *((n, "#7b1fa2", "three or more") for n in range(3, max(most, 3) + 1)),
            ),
        ),
        Picture(
            title="Where heights come from",
            raster=HEIGHT_SOURCE,
            style="classes",
            classes=(
                (0, "#000000", "no height, no texture"),
                (1, "#9a9a9a", "measured"),
                (2, "#fdae61", "interpolated for the texture only"),
            ),
        ),
    )


def texture_report(statistics: tuple[TileTexture, ...], radiometry: Radiometry, facts: TextureFacts) -> StageReport:
    """The report of the stage from the statistics of all tiles."""
    most = max((tile.most for tile in statistics), default=0)
    seen = np.sum([tile.seen for tile in statistics], axis=0)
    chart = Chart(
        title="Pixels by number of photos",
        style="bars",
        x_label="photos (3: three or more)",
        y_label="pixels",
        x=(0.0, 1.0, 2.0, 3.0),
        series={"pixels": tuple(float(n) for n in seen)},
    )
    return StageReport(
        figures=_figures(statistics, radiometry, facts),
        grids=(_photo_grid(statistics, radiometry),),
        charts=(chart,),
        pictures=_pictures(most),
        warnings=_warnings(statistics, radiometry),
    )
