"""Bands of a multispectral camera, told apart by their tags: one block is made of the colour photographs or, where there are none,
of one band.

Bands are photographs of one exposure through different lenses and filters. Together in one block they look like copies of each
other from places a few centimetres apart, which makes neither tie points nor heights. Thermal pictures beside visible ones are
treated alike: few pixels, little texture.
"""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import PurePath
from typing import NamedTuple

from orthomill.schemas.errors import PhotoError
from orthomill.schemas.photo import Header, PhotoRemark, PhotoRemarkCode

COLOUR, THERMAL = "colour", "thermal"
_GREEN = 560.0
"""nm: where sensors and vegetation give the best contrast of the visible bands; the nearest band makes the block"""
_WAVELENGTHS = {"blue": 475.0, "green": 560.0, "red": 665.0, "red edge": 720.0, "near infrared": 840.0}
_NAMES = {
    "b": "Blue",
    "blu": "Blue",
    "g": "Green",
    "gre": "Green",
    "r": "Red",
    "red": "Red",
    "re": "Red edge",
    "reg": "Red edge",
    "nir": "Near infrared",
}
"""endings of the names of files (DJI `_MS_G.TIF`, Parrot `_GRE.TIF`) -> bands"""
_ENDING = re.compile(r"(.+?)_(?:MS_)?(B|BLU|G|GRE|R|RED|RE|REG|NIR|\d{1,2})", re.IGNORECASE)


class OneBlock(NamedTuple):
    """The photographs of which the block is made, and remarks about those that are set aside."""

    headers: tuple[Header, ...]
    remarks: tuple[PhotoRemark, ...]


def one_block(headers: tuple[Header, ...], wanted: str | None = None) -> OneBlock:
    """Colour photographs, or those of one band (the `wanted` one); the others are set aside. A folder of one kind stays as it is.

    Raises PhotoError where no photograph is of the wanted band.
    """
    kinds = tuple(kind or COLOUR for kind in bands_of(headers))
    count = Counter(kinds)
    if wanted is not None and wanted.lower() not in map(str.lower, count):
        raise PhotoError(f"No photograph is of the band '{wanted}' (photographs > band); there are {', '.join(sorted(count))}.")
    if len(count) < 2:
        thermal = PhotoRemark(code=PhotoRemarkCode.THERMAL, photos=_paths(headers))
        return OneBlock(headers, (thermal,) if THERMAL in count else ())
    best = next((kind for kind in count if kind.lower() == (wanted or "").lower()), None) or _best(headers, kinds, count)
    aside = tuple(header for header, kind in zip(headers, kinds, strict=True) if kind != best)
    used = tuple(header for header, kind in zip(headers, kinds, strict=True) if kind == best)
    words = (*sorted(kind for kind in count if kind != best), best)
    return OneBlock(used, (PhotoRemark(code=PhotoRemarkCode.OTHER_BANDS, photos=_paths(aside), words=words),))


def _paths(headers: tuple[Header, ...]) -> tuple[str, ...]:
    return tuple(header.path for header in headers)


def _best(headers: tuple[Header, ...], kinds: tuple[str, ...], count: Counter[str]) -> str:
    """Colour unless there are only some stray ones; then panchromatic, then the band nearest to green, thermal last."""
    bands = [kind for kind in count if kind != COLOUR]
    if count[COLOUR] >= 2 and 2 * count[COLOUR] >= max(count[band] for band in bands):
        return COLOUR
    of_band = {kind: header for header, kind in zip(reversed(headers), reversed(kinds), strict=True)}
    return min(bands, key=lambda band: (band == THERMAL, _from_green(of_band[band].tags, band), band))


def _from_green(tags: Mapping[str, str], band: str) -> float:
    if band.lower().startswith("pan"):
        return -1.0
    stated = _number(_tag(tags, "CentralWavelength"))
    return abs((stated or _WAVELENGTHS.get(band.lower(), 10_000.0)) - _GREEN)


def bands_of(headers: tuple[Header, ...]) -> tuple[str | None, ...]:
    """The band of each photograph; None for colour and ordinary grey ones."""
    tagged = [_tagged_band(header) for header in headers]
    named = [_named_band(header) for header in headers]
    # An ending alone says nothing: names of one exposure must differ in it, and several exposures must have it.
    endings: dict[str, set[str]] = {}
    for start, ending in filter(None, named):
        endings.setdefault(start, set()).add(ending)
    several = {start for start, found in endings.items() if len(found) > 1}
    trusted = len(several) > 1
    return tuple(
        tag or (f"{name[1]}" if name and trusted and name[0] in several else None) for tag, name in zip(tagged, named, strict=True)
    )


def _tagged_band(header: Header) -> str | None:
    if "infrared" in _tag(header.tags, "ImageSource").lower():
        return THERMAL
    name = _tag(header.tags, "BandName")
    # A colour camera of a rig lists three bands.
    if header.bands != 1 or "," in name:
        return None
    return name or (f"{wavelength} nm" if (wavelength := _tag(header.tags, "CentralWavelength")) else None)


def _named_band(header: Header) -> tuple[str, str] | None:
    """What the name of a grey file begins with, and the band by its ending."""
    match = _ENDING.fullmatch(PurePath(header.path).stem)
    if header.bands != 1 or not match:
        return None
    ending = match[2].lower()
    return str(PurePath(header.path).with_name(match[1])), _NAMES.get(ending, f"band {ending}")


def _tag(tags: Mapping[str, str], name: str) -> str:
    """A tag of XMP, under whatever prefix its maker puts it."""
    return next((value.strip() for key, value in tags.items() if key.rpartition(":")[2] == name and value.strip()), "")


def _number(text: str) -> float | None:
    match = re.match(r"\d+(?:\.\d+)?", text)
    return float(match[0]) if match else None
