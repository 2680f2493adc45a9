"""Figures and pictures of coloured surfaces, in the same words whatever the surface is."""

from collections.abc import Iterable, Iterator

from orthomill.schemas.stage_report import Figure, Picture
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.blending.colour_sums import ColourSums

COVERAGE_COLOURS = ("#d7191c", "#1a9641", "#2b5fd9", "#9a9a9a")
"""Red 0, green 1, blue 2, grey 3 or more photos (Petsa et al. 2007, fig. 22)."""
MORE_SIDES = "Photographs from more sides would fill it."
"""what helps where no photograph sees the surface"""
_SEEN_BY = ("no photo", "one photo", "two photos", "three photos or more")


def percent(part: float, whole: float, digits: int) -> float:
    """A part of a whole in per cent; 0 of nothing."""
    return round(100.0 * part / whole, digits) if whole else 0.0


def rounded(value: float | None, digits: int) -> float | None:
    """A figure that may be missing."""
    return None if value is None else round(value, digits)


def coverage_classes(most: int) -> tuple[tuple[int, str, str], ...]:
    """Code, colour and meaning of every count of photographs up to `most`; counts of three or more share the grey."""
    return tuple(
        (count, COVERAGE_COLOURS[min(count, 3)], f"seen by {_SEEN_BY[count] if count < 3 else f'{count} photos'}")
        for count in range(max(most, 3) + 1)
    )


def coverage_picture(title: str, raster: str, classes: tuple[tuple[int, str, str], ...]) -> Picture:
    """How many photographs see each pixel."""
    caption = "How many photos see each pixel: more photos are needed where it is red."
    return Picture(title=title, raster=raster, style="classes", classes=classes, caption=caption)


def seen_figures(
    names: Iterable[str], sums: ColourSums, whole: float, digits: int, of: str, none: str = _SEEN_BY[0]
) -> Iterator[Figure]:
    """Parts of `whole` pixels that 0, 1, 2, 3 or more photographs see; `of` what, and what it means if there is `none`."""
    for name, count, words in zip(names, sums.seen, (none, *_SEEN_BY[1:]), strict=True):
        yield Figure(name=name, value=percent(count, whole, digits), unit="%", sentence=f"{of} seen by {words}.")


def rejected_figure(name: str, sums: ColourSums, digits: int) -> Figure:
    """Gross errors."""
    sentence = "Colours rejected as gross errors, of all colours."
    return Figure(name=name, value=percent(sums.rejected, sums.values, digits), unit="%", sentence=sentence)


def difference_figure(name: str, sums: ColourSums, digits: int) -> Figure:
    """How well the photographs agree."""
    sentence = "Mean absolute difference of the blended colours from their blend, after balance and rejection."
    return Figure(name=name, value=rounded(sums.difference, digits), unit="grey levels", sentence=sentence)


def balance_figure(name: str, value: float | None, when: str = "after") -> Figure:
    """How far two photographs differ `when` they were, or were not yet, adjusted to one brightness."""
    sentence = f"Mean absolute difference of two photos on the same ground {when} the radiometric balance."
    return Figure(name=name, value=value, unit="grey levels", sentence=sentence)


def balance_figures(radiometry: Radiometry, digits: int) -> Iterator[Figure]:
    """What the balance achieved."""
    yield balance_figure("balance_difference_before", rounded(radiometry.difference_before, digits), "before")
    yield balance_figure("balance_difference_after", rounded(radiometry.difference_after, digits))
    yield Figure(
        name="balance_difference_median_after",
        value=rounded(radiometry.difference_median_after, digits),
        unit="grey levels",
        sentence="Its median: free of vehicles and mismatches.",
    )
    yield Figure(name="balance_samples", value=radiometry.points, sentence="Ground samples used for the balance.")
