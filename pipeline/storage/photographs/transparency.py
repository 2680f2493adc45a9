"""What an image file says is no picture: transparent pixels, by an alpha channel, an inner mask or a value that stands for none.

Programs that cut away a sky, straighten a lens or black out people leave such pixels, whose colours mean nothing.
"""

import numpy as np
import rasterio
from rasterio.enums import MaskFlags, PhotometricInterp
from rasterio.windows import Window as GdalWindow

_OWN_BANDS = (None, PhotometricInterp.black, PhotometricInterp.white, PhotometricInterp.rgb, PhotometricInterp.ycbcr)
"""kinds of TIFF whose bands are read as they are"""
_OPAQUE = 250
"""of 255: what is less opaque is the soft rim of a mask, whose colours are mixed with those behind it"""


def is_masked(dataset: rasterio.DatasetReader) -> bool:
    """Whether the file can mask parts of its picture.

    A JPEG cannot: what GDAL takes for its mask lies behind its end. Nor can a TIFF in colours for printing, to which GDAL adds an
    alpha band as it converts them.
    """
    own = dataset.driver == "PNG" or dataset.photometric in _OWN_BANDS
    return own and dataset.driver != "JPEG" and MaskFlags.all_valid not in dataset.mask_flag_enums[0]


def opacity(dataset: rasterio.DatasetReader, part: GdalWindow) -> np.ndarray:
    """(rows, cols) of the file's dtype: its greatest value where there is picture, 0 where there is none."""
    full = np.iinfo(dataset.dtypes[0]).max
    return np.where(dataset.dataset_mask(window=part) >= _OPAQUE, full, 0).astype(dataset.dtypes[0])
