"""Photographs whose files are damaged, of another kind, or projected nowhere: what has to be said, or come out."""

import io
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from PIL import Image

from benchmarks.orientation.circumstances.altered_photographs import Altered, Flown, packet_of
from benchmarks.orientation.circumstances.circumstance import Circumstance
from orthomill.schemas.orientation import Block

NUMBERS = range(2, 10)
STRUCK = 5
"""Number of the photograph that is altered"""
PART = 3000
"""bytes of a scan that are written over"""


def picture_kinds() -> Iterator[Circumstance]:
    """All of them."""
    yield from _damaged()
    yield from _sound()
    yield from _others()
    yield from _systems()


def _damaged() -> Iterator[Circumstance]:
    noise = np.random.default_rng(5).integers(0, 255, PART, dtype=np.uint8).tobytes()
    for what, part in (("zeros", bytes(PART)), ("0xFF", b"\xff" * PART), ("bytes of another file", noise)):
        yield _said("damaged", f"{what} in the middle of a scan", _file(partial(_overwritten, part=part)), "damaged")
    yield _said("damaged", "a scan that ends early", _file(lambda data: data[: len(data) // 2]), "truncated")


def _sound() -> Iterator[Circumstance]:
    for what, options in (
        ("progressive", {"progressive": True}),
        ("with restart markers", {"restart_marker_blocks": 4}),
        ("grey", {"mode": "L"}),
    ):
        yield Circumstance("sound", f"one photograph {what}", _file(partial(_saved, **options)), None, "", _oriented(len(NUMBERS)))
    preview = _file(lambda data: data + data[: len(data) // 3])
    yield Circumstance("sound", "one with a preview behind its end", preview, None, "", _oriented(len(NUMBERS)))


def _others() -> Iterator[Circumstance]:
    tags = {"GPano:ProjectionType": "equirectangular", "GPano:FullPanoWidthPixels": "400"}
    panorama = Altered(NUMBERS, packet=lambda number: tags if number == STRUCK else {})
    yield Circumstance("other pictures", "a panorama among photographs", panorama, "a panorama", "", _oriented(len(NUMBERS) - 1))
    yield Circumstance(
        "other pictures",
        "PNG with a transparent border",
        Altered(NUMBERS, suffix=".png", picture=_bordered),
        "alpha",
        "",
        _oriented(len(NUMBERS)),
    )
    deep = Altered(
        NUMBERS, suffix=".tif", picture=lambda image: Image.fromarray(np.asarray(image.convert("L")).astype(np.uint16) * 16)
    )
    yield Circumstance("other pictures", "TIFF of 12 bits in 16", deep, None, "", _oriented(len(NUMBERS)))
    bands = Altered(NUMBERS, beside=_bands)
    yield Circumstance("other pictures", "single bands beside colour photographs", bands, None, "", _oriented(len(NUMBERS)))


def _systems() -> Iterator[Circumstance]:
    for crs, what, says in (
        ("EPSG:3857", "a scale of 1.46", "1.462 times as large as the ground"),
        ("EPSG:4326", "degrees", "in degrees"),
        ("EPSG:2193", "the grid of New Zealand", "is for longitudes"),
        ("EPSG:32615+5773", "heights above the geoid", "do not say what they refer to"),
    ):
        yield Circumstance("systems", f"init --crs {crs}: {what}", Altered(NUMBERS), says, "", None, ("--crs", crs))


def _said(kind: str, what: str, photographs: Altered, says: str) -> Circumstance:
    """What `init` has to say, with a block of the others."""
    return Circumstance(kind, what, photographs, None, says, _oriented(len(NUMBERS) - 1))


def _oriented(count: int) -> Callable[[Flown, Block], bool]:
    return lambda flown, block: len(block.photos) == count


def _file(change: Callable[[bytes], bytes]) -> Altered:
    """The struck photograph's file, changed as a file."""
    return Altered(NUMBERS, data=lambda number, data: change(data) if number == STRUCK else data)


def _overwritten(data: bytes, part: bytes) -> bytes:
    middle = len(data) * 2 // 3
    return data[:middle] + part + data[middle + len(part) :]


def _saved(data: bytes, mode: str = "RGB", **options: object) -> bytes:
    with Image.open(io.BytesIO(data)) as image:
        file = io.BytesIO()
        image.convert(mode).save(file, "JPEG", exif=image.getexif().tobytes(), quality=93, **options)
        return file.getvalue()


def _bordered(image: Image.Image) -> Image.Image:
    alpha = np.zeros(image.size[::-1], np.uint8)
    alpha[4:-4, 4:-4] = 255
    image = image.convert("RGB")
    image.putalpha(Image.fromarray(alpha))
    return image


def _bands(flown: Flown) -> dict[str, bytes]:
    """Band files of another camera, which took them at the same places."""
    files = {}
    for number in NUMBERS:
        for band, name in enumerate(("Red", "NIR")):
            file = io.BytesIO()
            Image.fromarray(np.asarray(flown.picture(number))[..., band]).save(
                file, "TIFF", exif=flown.tags(number), xmp=packet_of({"Camera:BandName": name})
            )
            files[f"DJI_{number:04d}_{name}.TIF"] = file.getvalue()
    return files
