"""What is known of a photograph before its pixels are looked at."""

from pydantic import BaseModel, ConfigDict

from schemas.job import Table


class Header(BaseModel):
    """The header of an image file. `tags` are EXIF tags by name, as text."""

    model_config = ConfigDict(frozen=True)

    path: str
    width: int
    height: int
    bands: int
    dtype: str
    tags: dict[str, str] = {}


class Photo(BaseModel):
    """One photograph, upright: width and height are after the EXIF orientation flag was obeyed."""

    model_config = ConfigDict(frozen=True)

    name: str
    path: str
    width: int
    height: int
    bands: int
    dtype: str
    exif_orientation: int = 1
    camera: str
    """Photographs with the same word here share one interior orientation."""
    focal_mm: float | None = None
    focal_35mm: float | None = None
    pixel_um: float | None = None
    longitude: float | None = None
    latitude: float | None = None
    altitude: float | None = None
    time: str | None = None
    position: tuple[float, float, float] | None = None
    """Projection centre X, Y, Z in the project's CRS from GNSS or EXIF, m."""
    position_sigma: tuple[float, float, float] | None = None
    levels: int = 1
    """Pyramid levels stored: rasters `photos/<name>/0` (full size) to `photos/<name>/<levels - 1>`, each halved."""


class Photos(BaseModel):
    """All photographs in the order of the workflow. Tie points name a photo by its number here."""

    model_config = ConfigDict(frozen=True)

    photos: tuple[Photo, ...]

    def __getitem__(self, name: str) -> Photo:
        return next(photo for photo in self.photos if photo.name == name)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(photo.name for photo in self.photos)


PHOTOS = Table("photos/photos.json", Photos)


def photo_raster(name: str, level: int = 0) -> str:
    """Name of the raster with the pixels of a photograph: (rows, cols, bands), uint8 or uint16, bands 1 or 3."""
    return f"photos/{name}/{level}"
