"""The circumstances by kind: what the tags of photographs and the files beside them say, and what has to be said of it."""

from collections.abc import Callable, Iterator

import numpy as np
from PIL import Image

from benchmarks.orientation.circumstances.altered_photographs import (
    ALTITUDE,
    EXIF,
    GPS,
    ORIENTATION,
    SEA_LEVEL,
    SERIAL,
    ZOOM,
    Altered,
    Flown,
)
from benchmarks.orientation.circumstances.circumstance import Circumstance
from benchmarks.orientation.circumstances.control_kinds import control_kinds
from benchmarks.orientation.circumstances.picture_kinds import picture_kinds
from orthomill.schemas.orientation import Block

SHORT, LONG = range(2, 10), range(18)
"""Photographs of two strips, and of three"""
FEW = range(2, 6)
ALIKE = 0.03
"""Share by which a ratio of camera constants may miss the true one"""


def circumstances() -> Iterator[Circumstance]:
    """All of them."""
    yield from _zooms()
    yield from _offsets()
    yield from _drones()
    yield from _heights()
    yield from _precision()
    yield from _formats()
    yield from _positions()
    yield from control_kinds()
    yield from picture_kinds()


def _zooms() -> Iterator[Circumstance]:
    for numbers in (SHORT, LONG):
        half = numbers[len(numbers) // 2]
        for factor in (1.3, 1.5, 2.0):
            photographs = Altered(numbers, zoom=_from(half, factor))
            what = f"zoom {factor:g} without a tag in half of {len(numbers)}"
            yield Circumstance("zoom", what, photographs, None, "times the camera constant of the other", _ratio(factor))
    tagged = Altered(SHORT, zoom=_from(6, 1.5), tags=lambda number, tags: _set(tags, ZOOM, 1.5 if number >= 6 else 1.0))
    yield Circumstance("zoom", "zoom 1.5 with its tag", tagged, "enlarged in the camera by digital zoom", "", _ratio(1.5))


def _offsets() -> Iterator[Circumstance]:
    for numbers, offset in ((SHORT, 15.0), (SHORT, -30.0), (LONG, 8.0)):
        half = numbers[len(numbers) // 2]
        photographs = Altered(numbers, tags=_raised(lambda number, half=half, offset=offset: offset * (number >= half)))
        what = f"heights of half of {len(numbers)} by {offset:+g} m"
        yield Circumstance("flights", what, photographs, None, "with an offset of their own")
    three = Altered(LONG, tags=_raised(lambda number: (0.0, 12.0, -9.0)[number // 6]))
    yield Circumstance("flights", "heights of three strips by 0, +12, -9 m", three, None, "with an offset of their own")


def _drones() -> Iterator[Circumstance]:
    two = Altered(SHORT, zoom=_from(6, 1.02), tags=lambda number, tags: _set(tags, SERIAL, "AB"[number >= 6] * 4))
    yield Circumstance("drones", "two serial numbers, constants 2 % apart", two, "B", "", _cameras(2))
    three = Altered(
        LONG, zoom=lambda number: 1.0 + 0.02 * (number // 6), tags=lambda number, tags: _set(tags, SERIAL, "ABC"[number // 6] * 4)
    )
    yield Circumstance("drones", "three serial numbers, constants 2 and 4 % apart", three, "CCCC", "", _cameras(3))


def _heights() -> Iterator[Circumstance]:
    yield Circumstance("below the sea", "all, nothing else tells", Altered(FEW, tags=_below(lambda number: True)), "below the sea")
    some = Altered(
        SHORT, tags=_below(lambda number: number % 2 == 1), packet=lambda number: {"drone-dji:AbsoluteAltitude": "+198.6"}
    )
    yield Circumstance("below the sea", "half, XMP says otherwise", some, "their heights were taken as above it")


def _precision() -> Iterator[Circumstance]:
    def rtk(number: int) -> dict[str, str]:
        sigma, flag = (("0.35", "0.8"), "34") if number in (4, 5) else (("0.012", "0.023"), "50")
        return {
            f"drone-dji:{name}": value
            for name, value in zip(("RtkStdLon", "RtkStdLat", "RtkStdHgt", "RtkFlag"), (sigma[0], *sigma, flag), strict=True)
        }

    yield Circumstance(
        "RTK", "two of eight with a float solution", Altered(SHORT, packet=rtk), "6 with a fixed solution, 2 with a float solution"
    )
    pix4d = Altered(FEW, packet=lambda number: {"Camera:GPSXYAccuracy": "0.015", "Camera:GPSZAccuracy": "0.03"})
    yield Circumstance("RTK", "as Pix4D names it", pix4d, "standard errors 0.015 m in plan, 0.03 m in height")


def _formats() -> Iterator[Circumstance]:
    for suffix, turn in ((".tif", 6), (".tif", 8), (".png", 1), (".png", 6)):
        photographs = Altered(range(4, 7), suffix=suffix, tags=lambda number, tags, turn=turn: tags.__setitem__(ORIENTATION, turn))
        yield Circumstance("tags of files", f"{suffix[1:].upper()}, orientation {turn}", photographs, "DJI FC300S 3.6")
    strangers = {
        "A.CR2": b"II*\0" + bytes(500),
        "B.heif": b"\0\0\0\x18ftypheic" + bytes(400),
        "C.MP4": b"\0\0\0\x18ftypmp42" + bytes(400),
    }
    yield Circumstance(
        "left out", "a raw photograph, a HEIF and a film beside", Altered(FEW, beside=lambda flown: strangers), "Left out"
    )
    card = Altered(FEW, name=lambda number: f"DCIM/{100 + number // 4}MEDIA/DJI_{number + 18:04d}")
    yield Circumstance("left out", "folders of a card", card, "4 JPEG")
    named = Altered(FEW, name=lambda number: f"flight {number // 4}/DJI_{number + 18:04d}")
    yield Circumstance("left out", "folders with names of their own", named, "4 JPEG")


def _positions() -> Iterator[Circumstance]:
    def lines(flown: Flown, one: str) -> str:
        rows = ((f"DJI_{number + 18:04d}", *flown.place(number)) for number in SHORT)
        return "".join(one.format(name=name, lat=lat, lon=lon, h=h) + "\n" for name, lat, lon, h in rows)

    odm, pix4d = "{name}.JPG {lon:.8f} {lat:.8f} {h:.3f}", "{name}.JPG,{lat:.8f},{lon:.8f},{h:.3f},2,3"
    files: tuple[tuple[str, str, Callable[[Flown], bytes]], ...] = (
        ("geo.txt", "OpenDroneMap's geo.txt", lambda flown: f"EPSG:4326\n{lines(flown, odm)}".encode()),
        ("geolocation.csv", "Pix4D's, with accuracies", lambda flown: lines(flown, pix4d).encode()),
        (
            "positionen.csv",
            "semicolons, decimal commas, UTF-16",
            lambda flown: (
                "Foto;Breite;Länge;Höhe\n" + lines(flown, "{name};{lat:.8f};{lon:.8f};{h:.3f}").replace(".", ",")
            ).encode("utf-16"),
        ),
    )
    for file, what, content in files:
        photographs = Altered(SHORT, with_gps=False, beside=lambda flown, file=file, content=content: {file: content(flown)})
        yield Circumstance("positions beside", what, photographs, f"{file} lies beside the photographs and is used")


def _from(first: int, factor: float) -> Callable[[int], float]:
    return lambda number: factor if number >= first else 1.0


def _set(tags: Image.Exif, tag: int, value: object) -> None:
    tags.get_ifd(EXIF)[tag] = value


def _raised(by: Callable[[int], float]) -> Callable[[int, Image.Exif], None]:
    def change(number: int, tags: Image.Exif) -> None:
        gps = tags.get_ifd(GPS)
        gps[ALTITUDE] = float(gps[ALTITUDE]) + by(number)

    return change


def _below(which: Callable[[int], bool]) -> Callable[[int, Image.Exif], None]:
    return lambda number, tags: tags.get_ifd(GPS).__setitem__(SEA_LEVEL, b"\x01" if which(number) else b"\x00")


def _ratio(factor: float) -> Callable[[Flown, Block], bool]:
    """Whether the block has two cameras, of which one has `factor` times the constant of the other."""

    def right(flown: Flown, block: Block) -> bool:
        constants = sorted(block.cameras[name].c for name in set(block.of_photo.values()))
        return len(constants) == 2 and abs(constants[1] / constants[0] / factor - 1.0) < ALIKE

    return right


def _cameras(count: int) -> Callable[[Flown, Block], bool]:
    return lambda flown, block: (
        len(set(block.of_photo.values())) == count and bool(np.isfinite([c.c for c in block.cameras.values()]).all())
    )
