"""What is known about a photograph before its pixels are read."""

from collections.abc import Mapping
from datetime import datetime
from enum import StrEnum
from math import nan
from typing import Literal

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.findings.position_findings import HeightsOfPositions, PositionsRead
from orthomill.schemas.job import Table

Decoding = Literal["anywhere", "in_order", "at_once"]
"""How the rows of a file can be had: each by itself; from the first one on, in order; or only all of them, held in memory."""


class Header(BaseModel):
    """The header of an image file. `tags` are EXIF tags by name, as text."""

    model_config = ConfigDict(frozen=True)

    path: str
    width: int
    height: int
    bands: int
    dtype: str
    masked: bool = False
    """The file can say of pixels that they are no picture, most often by an alpha channel, which `bands` does not count."""
    pictures: int = 1
    """pictures of this size that the file holds (pages of a TIFF)"""
    decoding: Decoding = "anywhere"
    # Text, because programs disagree about the types of tags: the same one occurs as a number, a fraction or a padded string.
    tags: dict[str, str] = {}
    damaged_tags: bool = False
    """The file has tags that cannot be read; `tags` is empty."""
    unusable: str = ""
    """Why the file is no photograph that can be used, as the end of a sentence that begins with its name; nothing else is known of
    it then."""

    @classmethod
    def of_unusable(cls, path: str, why: str) -> "Header":
        """All that is known of a file that is no photograph."""
        return cls(path=path, width=0, height=0, bands=0, dtype="", unusable=why)


class Soundness(BaseModel):
    """Whether the picture of an image file is whole. `fault`: what is wrong with it, and where; empty where it is sound, or of a
    kind in which only decoding finds faults."""

    model_config = ConfigDict(frozen=True)

    path: str
    fault: str = ""


Fix = Literal["fixed", "float", "single", "none"]
"""How a receiver found a position: carrier phases with integer ambiguities, with real ones, code alone, or not at all."""

HeightKind = Literal["ellipsoidal", "sea_level", "barometric", "relative"]
"""What the heights of the tags refer to: the ellipsoid, the sea, the sea by the air pressure (a constant of metres to hundreds of
metres unknown), or the place of take-off."""


class FactoryCamera(BaseModel):
    """The interior orientation that the tags give, in pixels of the file and the conventions of `Camera`; of the sensor, before the
    photograph is turned upright."""

    model_config = ConfigDict(frozen=True)

    kind: Literal["calibrated", "design"]
    """`calibrated`: measured at the factory or by the maker's program for this very camera; `design`: that of its drawings"""
    c: float
    affinity: float = 0.0
    x0: float = 0.0
    y0: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0


def tag_text(tags: Mapping[str, str], name: str) -> str:
    """An EXIF tag as text without padding, "" when it is absent; under its plain name ("Model") or GDAL's ("EXIF_Model")."""
    return (tags.get(name) or tags.get(f"EXIF_{name}") or "").strip("\0 \t\r\n")


class Photo(BaseModel):
    """One photograph, upright: width and height apply after the EXIF orientation."""

    model_config = ConfigDict(frozen=True)

    name: str
    path: str
    width: int
    height: int
    bands: int
    dtype: str
    masked: bool = False
    """Its raster has one more band, full where there is picture."""
    mask: str | None = None
    """the image file that is black where the photograph is not to be used"""
    mask_upright: bool = False
    """Its mask is turned upright already, unlike the file of the photograph itself."""
    decoding: Decoding = "anywhere"
    exif_orientation: int = 1
    as_taken: bool = False
    """Its pixels were rotated in the file and EXIF undoes it: upright, it has the orientation of the sensor."""
    camera: str
    """Photographs with the same name here share one interior orientation, that of the sensor."""
    original: tuple[int, int] | None = None
    """width and height, upright, that the camera wrote by its tags, where the file was reduced afterwards"""
    focal_mm: float | None = None
    focal_35mm: float | None = None
    pixel_um: float | None = None
    longitude: float | None = None
    latitude: float | None = None
    # Metres above whatever surface the receiver refers to: EXIF does not say reliably whether that is the ellipsoid or the geoid.
    altitude: float | None = None
    time: str | None = None
    """When it was taken, ISO 8601, to the fraction of a second that the tags give: in UTC where those of all photographs of the
    receiver tell it, otherwise by the camera's clock."""
    position: tuple[float, float, float] | None = None
    """Projection centre X, Y, Z in the project's CRS from GNSS or EXIF, m."""
    position_sigma: tuple[float, float, float] | None = None
    fix: Fix | None = None
    """How its position was found, where tags or the positions file say so."""
    height_kind: HeightKind | None = None
    """What `altitude` and the height of `position` refer to, where tags or the positions file say so."""
    relative_height: float | None = None
    """m above the place of take-off, by the tags"""
    attitude: tuple[float, float, float] | None = None
    """omega, phi, kappa in degrees, rough: from the positions file or the tags of the gimbal"""
    attitude_of: Literal["gimbal", "aircraft", "file"] | None = None
    """Where `attitude` comes from: gimbals hold a direction to some tenths of a degree, an aircraft leans by several."""
    serial: str | None = None
    """Serial number of the camera or of the drone that carries it; two of one model are two cameras."""
    flight: int = 0
    """Number of the flight: photographs of one receiver without a long break, which share the errors of its positions."""
    factory: FactoryCamera | None = None
    dewarped: bool = False
    """Its distortion was removed in the camera."""
    zoom: float = 1.0
    """Digital zoom: how many times the camera constant in pixels was enlarged."""
    readout_s: float | None = None
    """Time between the exposures of the first and the last row of the sensor (rolling shutter), where it is known."""
    speed: float | None = None
    """m/s over the ground, by the tags"""
    band: str | None = None
    """Name of the spectral band of a multispectral camera; None for colour and ordinary grey photographs."""
    # Affine and not a similarity: film shrinks differently along and across, and scanners have two scales.
    scan: tuple[float, float, float, float, float, float] | None = None
    """A scan in the frame of its fiducial marks: col = s0 + s1 col_file + s2 row_file, row = s3 + s4 col_file + s5 row_file, where
    col_file, row_file are pixels of the file and col, row those used everywhere else. None: the pixels of the upright file."""
    scan_size: tuple[int, int] | None = None
    """width and height of the file of a scan"""
    levels: int = 1
    """Pyramid levels stored: rasters `photos/<name>/0` (full size) to `photos/<name>/<levels - 1>`, each halved."""

    @property
    def seconds(self) -> float:
        """The time at which it was taken, s since 1970 by the clock that told it; NaN where none did."""
        moment = None if self.time is None else datetime.fromisoformat(self.time).replace(tzinfo=None)
        return nan if moment is None else (moment - datetime(1970, 1, 1)).total_seconds()

    @property
    def stored_bands(self) -> int:
        """Bands of its raster."""
        return self.bands + self.masked

    @property
    def sensor_orientation(self) -> int:
        """The rotation from the sensor to the upright photograph, as an EXIF orientation."""
        return 1 if self.as_taken else self.exif_orientation

    def from_file(self, col: float, row: float) -> tuple[float, float]:
        """The pixel of the photograph that a pixel of the (upright) file becomes; the two differ only for scans."""
        if self.scan is None:
            return col, row
        s = self.scan
        return s[0] + s[1] * col + s[2] * row, s[3] + s[4] * col + s[5] * row

    def holds(self, col: float, row: float) -> bool:
        """Whether a position lies on the photograph, including border pixels up to their outer edge."""
        # Integers are centres of pixels, hence the halves; without them measurements on the border pixels would be refused.
        return -0.5 <= col <= self.width - 0.5 and -0.5 <= row <= self.height - 0.5


# Stored as these words, not as numbers: tables remain readable, and a new code cannot collide with an old one.
class PhotoRemarkCode(StrEnum):
    """What was noticed about files and positions without being a reason to refuse them."""

    DUPLICATE_NAME = "duplicate_name"
    """Files have the same name; `photos` holds, for each one that is set aside, the path of the one that is used and its own."""
    STRAY_POSITION = "stray_position"
    """The GPS tag of a photograph lies `distance_km` from the others and is not used."""
    UNUSABLE_FILE = "unusable_file"
    """Files named like photographs hold none that can be used, and are set aside; `words`: why, for each."""
    DAMAGED_PICTURE = "damaged_picture"
    """The pictures of files are damaged, and these are set aside; `words`: where, and what is wrong, for each."""
    DAMAGED_TAGS = "damaged_tags"
    """The EXIF tags of photographs cannot be read; they are used like photographs without tags."""
    NO_ALTITUDE = "no_altitude"
    """The GPS tags of photographs have no altitude, or an impossible one; they are used like photographs without GPS."""
    POSITION_WITHOUT_PHOTOGRAPH = "position_without_photograph"
    """Lines of the positions file name photographs that the project does not have."""
    POSITIONS_FAR_APART = "positions_far_apart"
    """`photos` lie at least `distance_km` from all others, too far for one block; their positions are used all the same."""
    OTHER_BANDS = "other_bands"
    """Files of single bands of a multispectral camera, or thermal ones, are set aside; `words` are the bands, that of the block
    last."""
    THERMAL = "thermal"
    """The block is of thermal pictures: of their colours, not of temperatures."""
    PANORAMA = "panorama"
    """Panoramas, which no frame camera took in one exposure, are set aside; `words` is the projection."""
    ROTATED_WITHOUT_FLAG = "rotated_without_flag"
    """Photographs were rotated by a quarter turn by a program that left no EXIF flag."""
    OWN_PRECISION = "own_precision"
    """The tags of photographs state how good their positions are, and this is used; `words`: how they were found."""
    BELOW_SEA = "below_sea"
    """EXIF says that photographs were taken below the sea, other tags or photographs that they were not: taken as above it."""
    ALL_BELOW_SEA = "all_below_sea"
    """EXIF says of all photographs that they were taken below the sea, far enough to be a mistake; `words`: the height."""
    HEIGHT_ABOVE_START = "height_above_start"
    """GPSAltitude is the height above the take-off; the maker's height is used in its place."""
    HEIGHTS_DIFFER = "heights_differ"
    """EXIF and the maker's tags give different heights; those of EXIF are used."""
    RELATIVE_HEIGHTS = "relative_heights"
    """The only heights of photographs are those above the place of take-off."""
    FACTORY_CAMERA = "factory_camera"
    """The tags of photographs hold a calibration, which is the start of the adjustment."""
    MASK_FILES = "mask_files"
    """Photographs have masks in files of their own."""
    IDLE_MASK = "idle_mask"
    """Masks are named like no photograph of the project; `photos`: their files."""
    MASKED = "masked"
    """The files of photographs can mask parts of them, which are not used."""
    ON_THE_GROUND = "on_the_ground"
    """Photographs were taken at the height of the take-off, where the others were taken from the air."""
    CUT = "cut"
    """Files have another shape than the camera wrote by their tags; `words`: width and height by these."""
    NO_HEMISPHERE = "no_hemisphere"
    """GPS tags lack east or west, north or south, and were taken as east and north; `words`: which."""
    SEVERAL_PICTURES = "several_pictures"
    """Files hold several pictures of the size that is used, of which the first is; `words`: how many."""
    DEWARPED = "dewarped"
    """The distortion of photographs was removed in the camera."""
    DIGITAL_ZOOM = "digital_zoom"
    """Photographs were enlarged in the camera; `words`: by how much."""
    FIX_CONTRADICTED = "fix_contradicted"
    """Tags say that positions are fixed solutions, with standard errors that these do not have; `words`: the errors."""
    PLACE_IMPOSSIBLE = "place_impossible"
    """GPS tags hold degrees that are nowhere on the Earth; `words`: what may have happened."""
    PLACES_DIFFER = "places_differ"
    """EXIF and the maker's tags give different places; those of EXIF are used; `words`: the distance."""
    MAP_DATUM = "map_datum"
    """GPS tags name another datum than that of satellites; `words`: which."""
    EQUIVALENTS_DIFFER = "equivalents_differ"
    """35 mm equivalents differ within one camera and focal length, as a digital zoom without its tag makes them; `words`: which."""
    SAME_PLACE = "same_place"
    """Photographs of a flight have one and the same position to its last digit."""
    HEIGHT_KINDS_MIXED = "height_kinds_mixed"
    """Heights of some photographs refer to another surface than those of others; `words`: how many refer to which."""
    FACTORY_CONTRADICTED = "factory_contradicted"
    """The calibration in the tags contradicts their focal length and is not used; `words`: the camera constants by both, px."""
    SEVERAL_SERIALS = "several_serials"
    """Cameras of one model have different serial numbers; `photos`: the names of the cameras."""


class PhotoRemark(BaseModel):
    """One remark: its code, the photographs (or files) that it concerns, the distance of a stray position, what else is told."""

    model_config = ConfigDict(frozen=True)

    code: PhotoRemarkCode
    photos: tuple[str, ...]
    distance_km: float | None = None
    words: tuple[str, ...] = ()
    """what else the sentence names"""


class Photos(BaseModel):
    """All photographs in the order of the workflow. Tie points name a photo by its number here."""

    model_config = ConfigDict(frozen=True)

    photos: tuple[Photo, ...]
    remarks: tuple[PhotoRemark, ...] = ()
    """about files and positions that were set aside"""
    positions_read: PositionsRead | None = None
    """the positions file, where positions come from one"""
    heights: HeightsOfPositions | None = None
    """what the heights of the positions refer to; None without positions"""

    def __getitem__(self, name: str) -> Photo:
        return next(photo for photo in self.photos if photo.name == name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the photographs, in the order of `photos`."""
        return tuple(photo.name for photo in self.photos)


PHOTOS = Table("photos/photos.json", Photos)


def photo_raster(name: str, level: int = 0) -> str:
    """Name of the raster with the pixels of a photograph: (rows, cols, bands), uint8 or uint16, bands 1 or 3, and one more for a
    mask, which is full where there is picture."""
    return f"photos/{name}/{level}"
