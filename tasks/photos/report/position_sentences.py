"""What the positions were read from, in words."""

from collections.abc import Iterator

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.position_findings import HeightsOfPositions, PositionsRead
from orthomill.schemas.photo import Photos
from orthomill.tasks.photos.position_files.against_tags import BEYOND_GEOIDS

_TOLD_BY = {
    "workflow": "as the workflow states",
    "file": "as the file states",
    "degrees": "as the numbers show, which are degrees",
    "geocentric": "as the numbers show, which are geocentric",
    "project": "that of the project, as nothing states another",
}


def what_was_read(photos: Photos) -> Iterator[str]:
    """The positions file and what heights refer to, where nothing had to be assumed: worth a note, and no warning."""
    yield from (sentence for sentence, assumed in _sentences(photos) if not assumed)


def assumptions(photos: Photos) -> Iterator[str]:
    """What was assumed of the positions and may be wrong."""
    yield from (sentence for sentence, assumed in _sentences(photos) if assumed)


def _sentences(photos: Photos) -> Iterator[tuple[str, bool]]:
    """Sentences about the positions, and whether they tell of an assumption."""
    if read := photos.positions_read:
        unconfirmed = read.matched != "name" and read.confirmed is None
        off = read.rounded_m or read.heights_of_tags or read.off_tags_m or read.above_tags_m or read.moved or read.stepped
        assumed = bool(read.exchanged or read.defaults or read.raised or off or unconfirmed or read.encoding == "Windows-1252")
        yield read_sentence(read), assumed
    if photos.heights and (sentence := heights_sentence(photos.heights)):
        yield sentence, bool(photos.heights.target and photos.heights.unknown)


def read_sentence(read: PositionsRead) -> str:
    """The format, the system and the assumptions of a positions file, in one sentence for each."""
    lines = "1 position" if read.positions == 1 else f"{read.positions} positions"
    return " ".join([f"Positions: {read.format}, {lines}, {read.used} used, in {read.crs} ({_TOLD_BY[read.by]}).", *_more(read)])


def _more(read: PositionsRead) -> Iterator[str]:
    if read.matched != "name":
        how = "by the numbers in the names" if read.matched == "number" else "in their order"
        shown = {"times": "; the times of exposure agree", "places": "; the places in the GPS tags agree"}
        yield f"Exposures were assigned to photographs {how}{shown.get(read.confirmed or '', ', which nothing confirms')}."
    if read.exchanged:
        yield "The northing (or latitude) comes first in it: only so are the photographs where they were taken."
    if read.defaults:
        for_whom = "" if read.unstated in (0, read.used) else f" for {read.unstated} of them"
        yield (
            f"It states no standard errors{for_whom}: {read.defaults[0]:g} m in plan and {read.defaults[1]:g} m in height were "
            "taken (positions > sigma_plan, sigma_height)."
        )
    if read.raised:
        yield f"{read.raised} of them are no fixed solutions, and have the standard errors that such solutions deserve."
    if read.rounded_m:
        yield f"Its coordinates are rounded to {read.rounded_m:.2g} m: the standard errors were enlarged by that."
    if read.heights_of_tags:
        yield f"{read.heights_of_tags} of them have no height in it, and have that of the GPS tags."
    if read.off_tags_m:
        yield (
            f"They are {read.off_tags_m:.0f} m from where the GPS tags say that the photographs were taken: is it the file of this "
            "flight?"
        )
    if read.moved:
        much = "a photograph" if abs(read.moved) == 1 else f"{abs(read.moved)} photographs"
        other = "later" if read.moved > 0 else "earlier"
        yield (
            f"The GPS tags of the photographs lie where the file puts those that were taken {much} {other}: its names seem to be "
            "moved by that; compare a test shot, or the first exposure."
        )
    if read.above_tags_m:
        side = "above" if read.above_tags_m > 0 else "below"
        by_geoid = abs(read.above_tags_m) < BEYOND_GEOIDS
        why = (
            "as heights above the sea and above the ellipsoid are apart: state which they are (positions > crs), if heights matter."
            if by_geoid
            else "more than any geoid explains: do they count from the place of take-off?"
        )
        yield f"Their heights are {abs(read.above_tags_m):.0f} m {side} those of the GPS tags, {why}"
    if read.stepped:
        names, step = read.stepped
        side = "higher" if step > 0 else "lower"
        yield (
            f"Against the GPS tags the heights of {some_of(names, 4)} are {abs(step):.0f} m {side} than "
            "those of the others: are they of another flight, or of another height system?"
        )
    if read.without:
        yield f"{read.without} lines hold no position and were skipped."
    if read.angles:
        yield f"Its angles ({read.angles}) are taken as approximate attitudes."
    if read.antenna:
        yield "They are positions of the antenna: give its offset from the camera as lever_arm, or have it estimated."
    if read.encoding == "Windows-1252":
        yield "It is not in UTF-8 and was read as Windows-1252; check names with letters beyond A to Z."


def heights_sentence(heights: HeightsOfPositions) -> str | None:
    """What the heights of the positions refer to; None where nothing is known and nothing asked."""
    if heights.transformed and heights.system != heights.target:
        rest = f"; of {heights.unknown} others nothing tells what they refer to, and they keep their values" * bool(heights.unknown)
        return f"Heights of positions were transformed from {heights.system} to {heights.target}{rest}."
    if heights.target and heights.unknown:
        return (
            f"Nothing tells what the heights of {heights.unknown} positions refer to: they were taken as {heights.target}, which "
            "may be wrong by tens of metres. Say it: positions > crs, e.g. EPSG:4979 for heights above the ellipsoid."
        )
    if heights.system and not heights.target:
        return (
            f"Heights are those of the positions, {heights.system}: the crs of the project has no vertical part. For heights above "
            "the sea add one to it, e.g. +5773 (EGM96)."
        )
    return None
