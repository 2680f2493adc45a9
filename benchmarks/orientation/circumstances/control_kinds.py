"""Control as people have it: units, encodings, columns, errors; of each list, what has to be said or come out."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from rasterio.warp import transform

from benchmarks.orientation.circumstances.altered_photographs import Altered, Flown
from benchmarks.orientation.circumstances.circumstance import Circumstance
from benchmarks.orientation.circumstances.surveyed_points import Change, Mark, Survey, surveyed, unchanged
from orthomill.schemas.orientation import Block

NUMBERS = range(2, 10)
LIST = "{x:.3f} {y:.3f} {z:.3f} {col:.2f} {row:.2f} {file} {point}"
FEET = 3937 / 1200
"""US survey feet in a metre"""
PLAN_IN_FEET = "EPSG:26849"
"""Minnesota North in US survey feet"""
NEAR = 1.0
"""m by which ground and projection centres may miss those of the unaltered block"""

Listed = Callable[[Survey], bytes]


def control_kinds() -> Iterator[Circumstance]:
    """All lists of control."""
    yield from _units()
    yield from _forms()
    yield from _errors()


def _units() -> Iterator[Circumstance]:
    in_feet = partial(_moved, factor=FEET)
    kept, named = partial(_kept, "control: units"), partial(_named, "control: units")
    yield kept("plan and heights in US survey feet", "gcp_list.txt", partial(_text, crs=PLAN_IN_FEET, change=in_feet))
    yield named("heights in feet, plan in metres", partial(_text, change=in_feet), "seem to be in feet")
    yield named(
        "heights 28 m higher, by another system", partial(_text, change=partial(_moved, by=28.0)), "as heights in two systems do"
    )
    yield kept("pixels of photographs ten times as large", "gcp_list.txt", partial(_text, change=_in_originals))
    yield kept("longitude and latitude", "gcp_list.txt", partial(_text, crs="EPSG:4326", line=LIST.replace("3f", "8f", 2)))


def _forms() -> Iterator[Circumstance]:
    kept = partial(_kept, "control: forms")

    def encoded(change: Callable[[str], bytes]) -> Listed:
        return lambda survey: change(_text(survey).decode())

    yield kept("UTF-16", "gcp_list.txt", encoded(lambda text: text.encode("utf-16")))
    yield kept("a Latin-1 letter in a comment", "gcp_list.txt", encoded(lambda text: f"{text}# Süd\n".encode("latin-1")))
    yield kept(
        "a byte order mark, lines of Windows", "gcp_list.txt", encoded(lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"))
    )
    yield kept("tabs", "gcp_list.txt", encoded(lambda text: text.replace(" ", "\t").encode()))
    yield kept(
        "names in lower case", "gcp_list.txt", encoded(lambda text: text.replace("DJI_", "dji_").replace(".JPG", ".jpg").encode())
    )
    yield kept("names without extension", "gcp_list.txt", encoded(lambda text: text.replace(".JPG", "").encode()))
    yield kept("one height is nan", "gcp_list.txt", partial(_text, change=_without_height))
    yield kept("semicolons and decimal commas", "passpunkte.csv", _with_semicolons)


def _errors() -> Iterator[Circumstance]:
    named = partial(_named, "control: errors")
    yield named("two points exchanged", _exchanged, "gcp1 and gcp2 seem to be exchanged")
    turned = partial(_text, change=lambda mark: {"x": mark.y, "y": mark.x})
    yield _kept("control: errors", "northing before easting", "gcp_list.txt", turned)
    yield named(
        "another zone", lambda survey: _text(survey).replace(survey.block.crs.encode(), b"EPSG:32616"), "they would be there in"
    )
    yield named("all heights 0", partial(_text, change=partial(_moved, factor=0.0)), "have the height 0")
    yield named("from a web map, good to 0.7 m", partial(_text, change=_roughly), "The ground control is worse than stated")


def _text(survey: Survey, crs: str = "", change: Change = unchanged, line: str = LIST) -> bytes:
    return f"{crs or survey.block.crs}\n{survey.listed(line, change, crs)}".encode()


def _moved(mark: Mark, factor: float = 1.0, by: float = 0.0) -> dict[str, object]:
    return {"z": mark.z * factor + by}


def _in_originals(mark: Mark) -> dict[str, object]:
    return {"col": mark.col * 10 + 4.5, "row": mark.row * 10 + 4.5}


def _without_height(mark: Mark) -> dict[str, object]:
    return {"z": np.nan} if mark.point == "gcp1" else {}


def _with_semicolons(survey: Survey) -> bytes:
    line = "{point};{x:.3f};{y:.3f};{z:.3f};{file};{col:.2f};{row:.2f}"
    header = "Punkt;Rechtswert;Hochwert;Höhe;Foto;col;row\n"
    rows = survey.listed(line).replace(".JPG", "*JPG").replace(".", ",").replace("*JPG", ".JPG")
    return (header + rows).encode()


def _exchanged(survey: Survey) -> bytes:
    first, second = (next(mark for mark in survey.marks if mark.point == name) for name in ("gcp1", "gcp2"))

    def change(mark: Mark) -> dict[str, object]:
        place = {"gcp1": second, "gcp2": first}.get(mark.point, mark)
        return {"x": place.x, "y": place.y, "z": place.z}

    return _text(survey, change=change)


def _roughly(mark: Mark) -> dict[str, object]:
    x, y, z = np.random.default_rng(int(mark.point[-1])).normal(0.0, 0.7, 3)
    return {"x": mark.x + x, "y": mark.y + y, "z": mark.z + z}


def _kept(kind: str, what: str, file: str, content: Listed) -> Circumstance:
    """Control that is read as it is meant, and changes nothing."""
    return Circumstance(kind, what, _beside(file, content), None, "", _unmoved)


def _named(kind: str, what: str, content: Listed, first: str) -> Circumstance:
    return Circumstance(kind, what, _beside("gcp_list.txt", content), None, first)


def _unmoved(flown: Flown, block: Block) -> bool:
    """Whether the block rests on the control and lies where the unaltered one does."""
    true = surveyed(flown, NUMBERS).block
    centres = np.array([true.of(name).centre for name in block.names])
    found = np.array([photo.centre for photo in block.photos])
    east, north = transform(block.crs, true.crs, found[:, 0], found[:, 1])
    moved = np.column_stack([east, north, found[:, 2]]) - centres
    return "control" in block.datum and len(found) == len(true.photos) and float(np.abs(moved).max()) < NEAR


def _beside(file: str, content: Listed) -> Altered:
    return Altered(NUMBERS, beside=lambda flown: {file: content(surveyed(flown, NUMBERS))})
