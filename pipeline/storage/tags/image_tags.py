"""All tags of an image file that say what its camera knew, by name, as text: EXIF, XMP and the notes of makers.

EXIF tags have their plain names ("FocalLength"), those of XMP the prefix of their namespace ("drone-dji:RtkFlag"). Nothing is
interpreted here.
"""

from pathlib import Path

import rasterio

from orthomill.pipeline.storage.tags.exif_bytes import exif_tags, jpeg_exif, png_exif, tiff_tags
from orthomill.pipeline.storage.tags.xmp_tags import xmp_tags


def image_tags(path: Path, dataset: rasterio.DatasetReader) -> dict[str, str]:
    """The tags of an open image file by their names."""
    return {**_own_exif(path, dataset.driver), **carried_tags(dataset)}


def carried_tags(dataset: rasterio.DatasetReader) -> dict[str, str]:
    """The tags that GDAL reads, of a file or of what carries the tags of a photograph in another format."""
    return {**_exif(dataset), **xmp_tags(_domain(dataset, "xml:XMP"))}


def _exif(dataset: rasterio.DatasetReader) -> dict[str, str]:
    """EXIF tags without GDAL's prefix, and TIFF's own baseline tags under the names that EXIF gives them."""
    # GDAL keeps the EXIF tags of a JPEG in the default domain, those of a TIFF in the domain EXIF.
    found = {**_domain(dataset), **_domain(dataset, "EXIF")}
    tags = {name.removeprefix("EXIF_"): value for name, value in found.items() if name.startswith("EXIF_")}
    for tiff, exif in (("TIFFTAG_MAKE", "Make"), ("TIFFTAG_MODEL", "Model"), ("TIFFTAG_DATETIME", "DateTime")):
        if tiff in found:
            tags.setdefault(exif, found[tiff])
    return tags


def _domain(dataset: rasterio.DatasetReader, name: str | None = None) -> dict[str, str]:
    """A domain of GDAL's. A text that is not UTF-8 ends it: of XMP, which is one text, its readable letters are kept."""
    try:
        return dataset.tags(ns=name) if name else dataset.tags()
    except UnicodeDecodeError as error:
        return {"xml:XMP": error.object.decode(errors="replace")} if name == "xml:XMP" else {}


def _own_exif(path: Path, driver: str) -> dict[str, str]:
    """What GDAL does not read of EXIF."""
    if driver == "GTiff":
        return tiff_tags(path)
    return exif_tags(png_exif(path) if driver == "PNG" else jpeg_exif(path))
