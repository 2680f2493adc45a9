"""HEIC and raw photographs, read by the libraries of the extra `formats`: whole, for neither can be had in parts.

pi-heif (BSD-3; its wheel carries libheif and libde265, LGPL-3, and unlike that of pillow-heif no encoder under the GPL) and rawpy
(MIT; its wheel carries LibRaw, LGPL-2.1 or CDDL-1.0) are installed only by those who want them. HEIC arrives upright with 8 bits.
Raw photographs are developed with the camera's white balance and without automatic brightening, so that neighbours stay comparable,
to 16 bits in the orientation of the sensor.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from orthomill.pipeline.storage.photographs.file_kinds import EXTRA, RAW_SUFFIXES
from orthomill.schemas.errors import ContentError

Other = Literal["heif", "raw"]
_BRANDS = (b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1")
"""Brands of HEIF files with HEVC inside (ISO/IEC 23008-12, annex B)."""
_DEVELOPED = (b"\xff\xd8\xff", b"\x89PNG")
_LIBRARIES = {"heif": "pi_heif", "raw": "rawpy"}


class OtherHeader(NamedTuple):
    """Size and type of the pixels, and a small JPEG that carries the tags (None: the file itself carries them as a TIFF does)."""

    width: int
    height: int
    dtype: str
    tag_carrier: bytes | None


def other_format(path: Path, start: bytes) -> Other | None:
    """What a file is by its first bytes, and by its name where raw files begin like TIFF."""
    if start[4:8] == b"ftyp" and start[8:12] in _BRANDS:
        return "heif"
    return "raw" if path.suffix.lower() in RAW_SUFFIXES and not start.startswith(_DEVELOPED) else None


def read_other_header(path: Path, name: str, other: Other) -> OtherHeader:
    """The header of a photograph. `name`: as the user knows it. Raises ContentError."""
    with _library(name, other) as library:
        if other == "heif":
            picture = library.open_heif(path, convert_hdr_to_8bit=True)
            return OtherHeader(picture.size[0], picture.size[1], "uint8", _tag_carrier(picture.info))
        with library.imread(str(path)) as raw:
            return OtherHeader(raw.sizes.width, raw.sizes.height, "uint16", None)


def read_other_pixels(path: Path, name: str, other: Other) -> np.ndarray:
    """All pixels (rows, cols, 3). Raises ContentError."""
    with _library(name, other) as library:
        if other == "heif":
            picture = library.open_heif(path, convert_hdr_to_8bit=True)
            return np.asarray(picture.to_pillow().convert("RGB"))
        with library.imread(str(path)) as raw:
            return raw.postprocess(use_camera_wb=True, no_auto_bright=True, output_bps=16, user_flip=0)


@contextmanager
def _library(name: str, other: Other) -> Iterator[Any]:
    """The library for a format; whatever it raises is one sentence."""
    if not find_spec(_LIBRARIES[other]):
        raise ContentError(name, f"is a {'HEIC' if other == 'heif' else 'raw'} photograph", EXTRA)
    library: Any = __import__(_LIBRARIES[other])
    refusals = (ValueError, RuntimeError, EOFError, SyntaxError, OSError, *((library.LibRawError,) if other == "raw" else ()))
    try:
        yield library
    except refusals as error:
        kind = "HEIC" if other == "heif" else "raw"
        raise ContentError(
            name, f"cannot be read as a {kind} photograph ({error})", "copy it again from the camera, or save it as JPEG"
        ) from error


def _tag_carrier(info: dict[str, Any]) -> bytes:
    """A JPEG of a few pixels with the EXIF and XMP of another file: what reads tags reads these."""
    from PIL import Image  # pi-heif needs it as well

    tags = {name: info[name] for name in ("exif", "xmp") if info.get(name)}
    out = io.BytesIO()
    Image.new("L", (8, 8)).save(out, "JPEG", **tags)
    return out.getvalue()
