"""Image files as users have them: JPEG, TIFF and PNG, checked before they are trusted.

A file is checked before it is decoded: is it an image at all (the content decides, not the name), is it complete (its end marker),
is it of a sensible size and kind. Every refusal names the file and says what to do. Only three of GDAL's drivers are allowed, and
no sidecar file is read. Tags are passed on as text, uninterpreted (image_tags.py).
"""

import mmap
import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import rasterio
from rasterio._err import CPLE_BaseError
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import MemoryFile
from rasterio.windows import Window as GdalWindow

from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.photographs.jpeg_scan import Fault, broken_jpeg
from orthomill.pipeline.storage.photographs.other_formats import Other, other_format, read_other_header, read_other_pixels
from orthomill.pipeline.storage.photographs.transparency import is_masked, opacity
from orthomill.pipeline.storage.tags.image_tags import carried_tags, image_tags
from orthomill.schemas.errors import ContentError, PhotoError
from orthomill.schemas.memory import MIB
from orthomill.schemas.photo import Decoding, Header
from orthomill.schemas.raster import Window

PIXEL_LIMIT = 2_000_000_000
"""Larger images are refused before any of their pixels are decoded: a PNG of a few bytes can claim terabytes."""
_SIGNATURES = {
    b"\xff\xd8\xff": "JPEG",
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"II*\0": "GTiff",
    b"MM\0*": "GTiff",
    b"II+\0": "GTiff",
    b"MM\0+": "GTiff",
}
"""First bytes of a file -> the GDAL driver that may open it."""
# libjpeg fills the missing part of a damaged scan with grey and only warns; matched grey would look like a textureless surface.
# An .aux.xml or .ovr file next to the image could replace its statistics, georeference or pixels.
_GDAL = {
    "GDAL_ERROR_ON_LIBJPEG_WARNING": "YES",
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    # Its cache of decoded rows would otherwise take a twentieth of the machine in every process.
    "GDAL_CACHEMAX": 64 * MIB,
    # What a progressive JPEG takes is part of the memory that its job asks for.
    "GDAL_ALLOW_LARGE_LIBJPEG_MEM_ALLOC": "YES",
}
_PIECE = 128
"""Rows that are decoded at a time: all bands of so many rows are in the cache, so that no row is decoded once for each band."""

_PROGRESSIVE = frozenset({0xC2, 0xC6, 0xCA, 0xCE})
"""Start-of-frame markers of progressive JPEG (ISO/IEC 10918-1, table B.1)."""
_PAGES = 64
"""pages of a TIFF that are looked at"""
_LARGE_BLOCK = 1024
"""rows of a block of a TIFF beyond which tiles would decode it many times"""


COPY_AGAIN = "copy it again from the camera"


def header_or_fault(path: Path) -> Header:
    """The header of an image file; one that says why, where the file holds no photograph that can be used. Raises PhotoError for a
    file that is not there or cannot be read."""
    try:
        return read_header(path)
    except ContentError as error:
        return Header.of_unusable(str(path), error.found)


def read_header(path: Path) -> Header:
    """Size, bands, dtype and EXIF tags of an image file. Raises ContentError for anything but a complete photograph, PhotoError for
    a file that cannot be read."""
    other = other_format(path, _first_bytes(path))
    if other:
        return _other_header(path, other)
    with _opened(path) as dataset:
        damaged = _has_damaged_tags(dataset)
        _check_size(path, dataset)
        bands = _colour_bands(path, dataset)
        # GDAL opens a truncated file without complaint and fails in the last tile, possibly hours later.
        if dataset.driver in _END_CHECKS:
            _END_CHECKS[dataset.driver](path)
        elif dataset.driver == "GTiff":
            _check_tiff_end(path, dataset)
        return Header(
            path=str(path),
            width=dataset.width,
            height=dataset.height,
            bands=bands,
            dtype=dataset.dtypes[0],
            masked=is_masked(dataset),
            pictures=_pictures(path, dataset),
            decoding=_decoding(path, dataset),
            tags={} if damaged else image_tags(path, dataset),
            damaged_tags=damaged,
        )


def _other_header(path: Path, other: Other) -> Header:
    """The header of a HEIC or raw photograph; the tags are read from what carries them."""
    found = read_other_header(path, shown(path), other)
    if found.width * found.height > PIXEL_LIMIT:
        raise _too_large(path, found.width, found.height)
    with rasterio.Env(**_GDAL), _tagged(path, found.tag_carrier) as dataset:
        tags = {} if dataset is None or _has_damaged_tags(dataset) else carried_tags(dataset)
    if other == "heif":
        tags.pop("Orientation", None)  # HEIC states its rotation itself, and arrives upright
    size = {"width": found.width, "height": found.height}
    return Header(path=str(path), **size, bands=3, dtype=found.dtype, decoding="at_once", tags=tags)


@contextmanager
def _tagged(path: Path, carrier: bytes | None) -> Iterator[rasterio.DatasetReader | None]:
    """What carries the tags of a photograph, for reading them; None where nothing can be opened."""
    with ExitStack() as stack, warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            if carrier:
                dataset = stack.enter_context(stack.enter_context(MemoryFile(carrier)).open(driver="JPEG"))
            else:
                dataset = stack.enter_context(rasterio.open(Path(path).absolute(), driver="GTiff"))
        except (RasterioError, CPLE_BaseError):
            dataset = None
        yield dataset


def read_pixels(path: Path, window: Window) -> np.ndarray:
    """Pixels of a window, (height, width, bands) with 1 or 3 bands, as stored: the EXIF orientation flag is not applied here.

    A file that masks pixels has one more band, full where there is picture and 0 elsewhere. Raises PhotoError when the file is not
    an image or ends inside the window.
    """
    other = other_format(path, _first_bytes(path))
    if other:
        pixels = read_other_pixels(path, shown(path), other)
        _check_window(path, window, pixels.shape[:2])
        return pixels[window.row : window.row + window.height, window.col : window.col + window.width]
    with _reading(path) as dataset:
        _has_damaged_tags(dataset)
        _check_size(path, dataset)
        bands = _colour_bands(path, dataset)
        _check_window(path, window, dataset.shape)
        # Once for each photograph: one of its windows begins with its first row.
        if window.row == 0 and dataset.driver == "JPEG":
            _check_jpeg_picture(path)
        try:
            return _decoded(dataset, window, bands)
        except RasterioError as error:
            rows = f"{window.row} to {window.row + window.height - 1}"
            raise PhotoError(
                f"{shown(path)} cannot be decoded in the rows {rows}: the file is damaged or was not copied "
                "completely; copy it again from the camera."
            ) from error


def _check_window(path: Path, window: Window, shape: tuple[int, int]) -> None:
    if window.clipped(shape) != window or window.empty:
        raise PhotoError(
            f"{shown(path)} has {shape[1]} x {shape[0]} px, and {window} is not inside it; "
            "the file has changed since it was first read, so run again."
        )


def _decoded(dataset: rasterio.DatasetReader, window: Window, bands: int) -> np.ndarray:
    masked = is_masked(dataset)
    pixels = np.empty((*window.shape, bands + masked), dataset.dtypes[0])
    piece, factor = max(_PIECE, dataset.block_shapes[0][0]), _full_scale(dataset)
    for row in range(0, window.height, piece):
        part = GdalWindow(window.col, window.row + row, window.width, min(piece, window.height - row))
        pixels[row : row + piece, :, :bands] = factor * np.moveaxis(dataset.read(list(range(1, bands + 1)), window=part), 0, -1)
        if masked:
            pixels[row : row + piece, :, bands] = opacity(dataset, part)
    return pixels


def _full_scale(dataset: rasterio.DatasetReader) -> np.uint8:
    """What grey values of less than 8 bits are multiplied with, so that white is 255: masks are often saved with 1 bit."""
    bits = int(dataset.tags(1, ns="IMAGE_STRUCTURE").get("NBITS", 8))
    return np.uint8(255 // (2**bits - 1) if bits < 8 else 1)


class _Kept(threading.local):
    """The file that this thread read last, left open where it is decoded in order: the next window need not begin at its top."""

    state: tuple[Path, int, int] | None = None
    dataset: rasterio.DatasetReader | None = None

    def take(self, state: tuple[Path, int, int]) -> rasterio.DatasetReader | None:
        """The open file if it is this one, unchanged; another one is closed."""
        dataset, same = self.dataset, self.state == state
        self.state = self.dataset = None
        if dataset is not None and not same:
            dataset.close()
        return dataset if same else None


_KEPT = _Kept()


@contextmanager
def _reading(path: Path) -> Iterator[rasterio.DatasetReader]:
    """A file to read pixels from. Closed afterwards, unless the next window of it may go on where this one ends."""
    _first_bytes(path)
    status = os.stat(path)
    state = path, status.st_size, status.st_mtime_ns
    with rasterio.Env(**_GDAL):
        dataset = _KEPT.take(state) or _open(path)
        try:
            yield dataset
        except BaseException:
            dataset.close()
            raise
        if _decoding(path, dataset) == "in_order":
            _KEPT.state, _KEPT.dataset = state, dataset
        else:
            dataset.close()


@contextmanager
def _opened(path: Path) -> Iterator[rasterio.DatasetReader]:
    with rasterio.Env(**_GDAL), _open(path) as dataset:
        yield dataset


def _open(path: Path) -> rasterio.DatasetReader:
    """An image file, by GDAL's driver for what it holds; within GDAL's settings."""
    driver = _driver(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            return _largest_page(rasterio.open(Path(path).absolute(), driver=driver))
        except (RasterioError, CPLE_BaseError) as error:
            raise ContentError(
                shown(path),
                "begins like an image, but cannot be opened: the file is damaged or was not copied completely",
                COPY_AGAIN,
            ) from error


def _largest_page(dataset: rasterio.DatasetReader) -> rasterio.DatasetReader:
    """The page of a TIFF with the most pixels: some programs put a preview first."""
    largest = dataset
    for name in dataset.subdatasets[:_PAGES] if dataset.driver == "GTiff" else ():
        page = rasterio.open(name, driver="GTiff")
        smaller = page if page.width * page.height <= largest.width * largest.height else largest
        largest = largest if smaller is page else page
        smaller.close()
    return largest


def _pictures(path: Path, dataset: rasterio.DatasetReader) -> int:
    """Pictures of the size of this page that the file holds."""
    if dataset.driver != "GTiff":
        return 1
    count = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path.absolute(), driver="GTiff") as first:
            names = first.subdatasets[:_PAGES]
        for name in names:
            with rasterio.open(name, driver="GTiff") as page:
                count += page.shape == dataset.shape
    return max(count, 1)


def _decoding(path: Path, dataset: rasterio.DatasetReader) -> Decoding:
    if dataset.driver == "GTiff":
        # A block is decoded as a whole; writers of a single strip are common.
        return "anywhere" if dataset.block_shapes[0][0] <= _LARGE_BLOCK else "in_order"
    with open(path, "rb") as file:
        if dataset.driver == "PNG":
            # The interlace method is the last byte of the first chunk (PNG specification, 11.2.2).
            return "at_once" if file.read(29)[-1:] == b"\1" else "in_order"
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            return "at_once" if any(marker in _PROGRESSIVE for marker, _ in _segments(content)) else "in_order"


def _has_damaged_tags(dataset: rasterio.DatasetReader) -> bool:
    """Whether EXIF cannot be read. GDAL reads it when the file is opened and fails with the first question, whatever is asked; all
    later questions are answered."""
    try:
        _ = dataset.tags(), dataset.colorinterp
    except CPLE_BaseError:
        return True
    return False


def _driver(path: Path) -> str:
    """GDAL's driver for what the file holds, whatever its name says."""
    start = _first_bytes(path)
    for signature, driver in _SIGNATURES.items():
        if start.startswith(signature):
            return driver
    what = "plain text" if _is_text(start) else "another kind of file"
    raise ContentError(
        shown(path), f"is not a JPEG, TIFF or PNG image but {what}, whatever its name says", "remove it from the photographs"
    )


def _first_bytes(path: Path) -> bytes:
    try:
        with open(path, "rb") as file:
            start = file.read(512)
    except FileNotFoundError:
        raise PhotoError(f"The photograph {shown(path)} does not exist; put it there or remove it from the workflow.") from None
    except OSError as error:
        raise PhotoError(f"The photograph {shown(path)} cannot be read ({error.strerror}).") from error
    if not start:
        raise ContentError(shown(path), "is empty (0 bytes)", COPY_AGAIN)
    return start


def _is_text(start: bytes) -> bool:
    # Tab to carriage return (9 to 13) are the only control characters of ordinary text.
    return not any(byte < 9 or 13 < byte < 32 for byte in start)


def _check_size(path: Path, dataset: rasterio.DatasetReader) -> None:
    if dataset.width * dataset.height > PIXEL_LIMIT:
        raise _too_large(path, dataset.width, dataset.height)


def _too_large(path: Path, width: int, height: int) -> ContentError:
    claim = f"claims {width} x {height} px, which is {width * height / 1e9:.1f} gigapixels"
    advice = f"more than {PIXEL_LIMIT / 1e9:g} gigapixels are refused unread, so split it into parts if it is genuine"
    return ContentError(shown(path), claim, advice)


def _colour_bands(path: Path, dataset: rasterio.DatasetReader) -> int:
    """1 or 3, an alpha band left out."""
    meanings = dataset.colorinterp
    bands = sum(meaning != ColorInterp.alpha for meaning in meanings)
    if ColorInterp.palette in meanings:
        raise ContentError(shown(path), "has a colour palette", "save it as grey or RGB")
    if bands not in (1, 3):
        raise ContentError(shown(path), f"has {bands} bands", "save it as grey (1 band) or RGB (3 bands)")
    if any(dtype not in ("uint8", "uint16") for dtype in dataset.dtypes):
        raise ContentError(shown(path), f"holds {dataset.dtypes[0]} values", "save it with 8 or 16 bits per band")
    return bands


def _check_jpeg_end(path: Path) -> None:
    """A complete JPEG has an end-of-image marker after its last scan; the thumbnail's marker, in the header, does not count."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content.rfind(b"\xff\xd9", _first_scan(content)) < 0:
            raise _truncated(path, "the end-of-image marker of a JPEG is missing")


_FAULTS = {
    Fault.NO_SUCH_CODE: "codes that the file does not define",
    Fault.BEYOND_BLOCK: "more values in a block than it has pixels",
    Fault.IMPOSSIBLE_GREY: "brightness that no pixels have",
    Fault.ENDS_EARLY: "too few data for its size",
    Fault.DATA_LEFT: "more data than its size takes",
    Fault.OUT_OF_TURN: "restart markers out of turn",
}


def picture_fault(path: Path) -> str:
    """What is wrong with the picture of a JPEG, and where; empty for a sound one, for other formats, whose decoders find faults,
    and for files that hold none, which their headers tell. Raises PhotoError for a file that cannot be read."""
    try:
        start = _first_bytes(path)
    except ContentError:
        return ""
    # Decoders go on behind damage with a picture that is displaced and recoloured: matched, it would be a wrong surface.
    broken = broken_jpeg(path.read_bytes()) if start.startswith(b"\xff\xd8\xff") else None
    if broken is None:
        return ""
    where = f"at {100 * broken.share:.0f} % of its height or before" if broken.share < 1 else "somewhere"
    return f"damaged {where}: it holds {_FAULTS[broken.fault]}"


def _check_jpeg_picture(path: Path) -> None:
    """The codes of a JPEG make sense from the first to the last."""
    if fault := picture_fault(path):
        raise PhotoError(
            f"The picture in {shown(path)} is {fault}; copy the file again from the camera, or leave it out of the photographs."
        )


def _first_scan(content: mmap.mmap) -> int:
    """Offset of the first start-of-scan marker, found by following the segments, so that embedded thumbnails are skipped."""
    ends = [2, *(after for _, after in _segments(content))]
    return min(ends[-1], len(content))


def _segments(content: mmap.mmap) -> Iterator[tuple[int, int]]:
    """The marker of every segment before the first scan, and the offset of what follows it."""
    at = 2
    while at + 4 <= len(content) and content[at] == 0xFF and content[at + 1] != 0xDA:
        marker = content[at + 1]
        # A marker may be preceded by any number of fill bytes 0xFF (ISO/IEC 10918-1, B.1.1.2).
        at += 1 if marker == 0xFF else 2 + int.from_bytes(content[at + 2 : at + 4], "big")
        yield marker, at


def _check_png_end(path: Path) -> None:
    with open(path, "rb") as file:
        # The end chunk is 12 bytes; cameras and editors append a few more after it.
        file.seek(max(os.path.getsize(path) - 4096, 0))
        if b"IEND\xaeB`\x82" not in file.read():
            raise _truncated(path, "the end chunk of a PNG is missing")


def _check_tiff_end(path: Path, dataset: rasterio.DatasetReader) -> None:
    """The last block of a TIFF, where the file says that it lies, ends within the file."""
    rows, cols = dataset.block_shapes[-1]
    last = f"{(dataset.width - 1) // cols}_{(dataset.height - 1) // rows}"
    ends = [dataset.get_tag_item(f"BLOCK_{what}_{last}", "TIFF", bidx=dataset.count) for what in ("OFFSET", "SIZE")]
    if None not in ends and sum(map(int, ends)) > os.path.getsize(path):
        raise _truncated(path, "the pixels of a TIFF go on beyond its end")


_END_CHECKS = {"JPEG": _check_jpeg_end, "PNG": _check_png_end}


def _truncated(path: Path, sign: str) -> ContentError:
    return ContentError(shown(path), f"is truncated ({os.path.getsize(path)} bytes, {sign})", COPY_AGAIN)
