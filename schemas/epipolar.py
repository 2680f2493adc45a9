"""The normal case of a pair: two images with parallel axes, the base along x, homologous points on the same row."""

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table


class EpipolarPair(BaseModel):
    """Geometry of one pair of epipolar images. Pure central projections: no principal point offset, no distortion.

    Both images share `rotation` (world to base system: x along the base, looking along -z), the camera constant `c` (px), the
    number of rows and the principal row, so that homologous points have the same row. Image coordinates of pixel (col, row) are
    x = col - col0, y = row0 - row. With parallax p = x_left - x_right the point in the base system is
    (x_left, y, -c) * base / p from the left projection centre.
    """

    model_config = ConfigDict(frozen=True)

    name: str
    """left-right"""
    left: str
    right: str
    level: int = 0
    """pyramid level of the photographs that the images are made from: one pixel stands for 2^level x 2^level of the photographs"""
    # Rotation, c and row0 exist once: if the two images differed in any of them, homologous rows would not agree over the whole
    # image.
    rotation: tuple[tuple[float, float, float], ...]
    left_centre: tuple[float, float, float]
    right_centre: tuple[float, float, float]
    base: float
    """m"""
    c: float
    row0: float
    # One column origin per image: only the rows must agree, and each image is cropped to the ground that both photographs see.
    left_col0: float
    right_col0: float
    rows: int
    left_cols: int
    right_cols: int
    # With a margin, because tie points are sparse: the highest roof or mast rarely carries one, but must lie in the search range.
    parallax_low: float
    parallax_high: float
    """range of x_left - x_right over the heights of the block, with a margin, px"""
    # The usual measure of intersection geometry: the standard error of a height is that of the parallax, in ground units, over it.
    base_height: float
    """base over mean height above ground"""
    # The covariance of a weak block predicts many pixels where tie points measure a tenth: what is measured outweighs it.
    row_sigma: float
    """standard error of the y-parallax on the common ground, px: measured by the tie points of the pair, predicted without them"""
    row_sigma_predicted: float = 0.0
    """what the precision of the orientation predicts: root mean square over the common ground, px"""
    # Nine places: errors of the orientation deform the heights smoothly, so that bilinear interpolation between these suffices.
    height_sigmas: tuple[float, ...] = ()
    """standard errors of heights due to the orientation, m: (9,) at three rows and three columns of the left image, from the upper
    left to the lower right corner; empty where the orientation has no covariance"""

    @property
    def column_offset(self) -> float:
        """Column parallax (column left - column right) minus parallax, px: parallaxes count from the principal columns."""
        return self.left_col0 - self.right_col0


class EpipolarPairs(BaseModel):
    """The pairs to be matched."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[EpipolarPair, ...]
    not_used: tuple[tuple[str, str], ...] = ()
    """(pair, reason)"""
    heights: tuple[float, float] | None = None
    """lowest and highest height that the pairs are to cover, m; None: all that their parallaxes allow"""


class GreyRange(BaseModel):
    """The grey values of a photograph that map to 0 and 255: one contrast stretch for all its tiles, which avoids seams."""

    model_config = ConfigDict(frozen=True)

    # The defaults are the identity: stretching 8 bits into 8 bits adds rounding errors but no information.
    low: float = 0.0
    high: float = 255.0


def grey_table(photo: str) -> Table[GreyRange]:
    """Written by `epipolar` for every 16-bit photograph of a pair; photographs of 8 bits are used unchanged."""
    return Table(f"epipolar/grey/{photo}.json", GreyRange)


PAIRS = Table("epipolar/pairs.json", EpipolarPairs)


def epipolar_raster(pair: str, side: str) -> str:
    """Grey uint8 epipolar image, `side` is left or right; 0 is outside the photograph, whose pixels are 1 or more."""
    return f"epipolar/{pair}/{side}"
