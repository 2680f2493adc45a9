"""A virtual raster (VRT) that joins the sheets of one.

What it says of the pixels is what GDAL reads of a GeoTIFF of the whole. Its sources are named relative to it and with their sizes:
none is opened before something of it is shown. At small scales GDAL takes the overviews of the sheets.

Source: gdal.org, driver VRT.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import rasterio.shutil

from orthomill.pipeline.export.geotiff.band_stack import Stack
from orthomill.pipeline.export.geotiff.cloud_geotiff import described_file
from orthomill.pipeline.export.geotiff.cloud_layout import TILE
from orthomill.schemas.raster import Window


def write_virtual(stack: Stack, sheets: Mapping[str, Window], path: Path) -> None:
    """The file of a raster that joins `sheets`: their paths as seen from it, and the windows that they hold. Raises OSError,
    RasterioError."""
    described = described_file(stack, stack.first.full, None, path.parent)
    rasterio.shutil.copy(described, path, driver="VRT")
    whole = ET.fromstring(path.read_text(encoding="utf-8"))  # noqa: S314  just written by GDAL
    rows, cols = stack.first.full.shape
    whole.attrib |= {"rasterXSize": str(cols), "rasterYSize": str(rows)}
    for band in whole.iter("VRTRasterBand"):
        for described_pixels in band.findall("SimpleSource"):
            band.remove(described_pixels)
        band.extend(_source(band, name, window) for name, window in sheets.items())
    ET.indent(whole)
    path.write_bytes(ET.tostring(whole, encoding="utf-8") + b"\n")


def _source(band: ET.Element, name: str, window: Window) -> ET.Element:
    """A sheet in one of its bands."""
    size = {"xSize": str(window.width), "ySize": str(window.height)}
    source = ET.Element("SimpleSource")
    ET.SubElement(source, "SourceFilename", relativeToVRT="1").text = name
    ET.SubElement(source, "SourceBand").text = band.attrib["band"]
    held = {"RasterXSize": str(window.width), "RasterYSize": str(window.height), "DataType": band.attrib["dataType"]}
    ET.SubElement(source, "SourceProperties", held | {"BlockXSize": str(TILE), "BlockYSize": str(TILE)})
    ET.SubElement(source, "SrcRect", {"xOff": "0", "yOff": "0"} | size)
    ET.SubElement(source, "DstRect", {"xOff": str(window.col), "yOff": str(window.row)} | size)
    return source
