"""Photographs of a rolling land, rendered cheaply: fields under fractal noise as an orthoimage, in perspective over relief.

A photograph takes a tenth of a second: every pixel's ray meets the smooth relief after a few steps from height to place and back,
and takes the grey value that the orthoimage has there. No walls and no trees: what is wanted are blocks of any size whose files,
overlap, relief and texture are those of a drone's, not a trial of the matching.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from pyproj import Transformer
from scipy.spatial import cKDTree

from orthomill.tasks.geometry.rotation import rotation_matrix

WIDTH, HEIGHT, CONSTANT = 1152, 868, 1000.0
"""a frame of one megapixel and its camera constant, px"""
PIXEL, FLYING = 0.1, 100.0
"""m on the ground: side of a pixel of the orthoimage and, at the mean height, of a photograph; height above that"""
BASE, BETWEEN = 22.0, 46.0
"""m between photographs of a strip (75 % overlap) and between strips (60 %)"""
MARGIN = 90.0
"""m of land around the outermost projection centres"""
CORNER, CRS = (600_000.0, 4_350_000.0, 200.0), "EPSG:32634"
"""south-western corner of the land and its mean height"""
_BAND, _COARSE = 512, 16
_LATTICE = 2.0  # m between heights
_GNSS = (1.5, 1.5, 2.5)  # m: what a drone's receiver is good for
_STEPS = 6  # relief of a tenth of the flying height converges by a factor of 10 in each


@dataclass(frozen=True)
class Station:
    """A photograph: file `name`, projection centre (m, from the corner) and rotation from the world to the image."""

    name: str
    centre: np.ndarray
    rotation: np.ndarray


def stations(strips: int, per: int) -> list[Station]:
    """Photographs of the first `per` places of the first `strips` strips, flown to and fro; a smaller block is part of a larger."""
    found = []
    for strip in range(strips):
        for place in range(per) if strip % 2 == 0 else reversed(range(per)):
            # By strip and place, so that a block of any size has the same photographs.
            rng = np.random.default_rng((7, strip, place))
            centre = np.array([MARGIN + BETWEEN * strip, MARGIN + BASE * place, FLYING]) + rng.normal(0, (1.0, 1.0, 1.5))
            heading = 0.0 if strip % 2 == 0 else np.pi
            found.append(
                (strip, centre, rotation_matrix(*np.radians(rng.normal(0, 2.5, 2)), heading + np.radians(rng.normal(0, 4))))
            )
    return [Station(f"s{strip:02d}_{number:04d}", centre, R) for number, (strip, centre, R) in enumerate(found)]


@dataclass(frozen=True)
class Land:
    """Land for `strips` of `per` photographs; its orthoimage is kept in `folder`."""

    folder: Path
    strips: int
    per: int

    @property
    def extent(self) -> tuple[float, float]:
        """m to the east and to the north."""
        return 2 * MARGIN + BETWEEN * self.strips, 2 * MARGIN + BASE * self.per

    @cached_property
    def heights(self) -> np.ndarray:
        """Heights (m above the mean) at a lattice from the corner, rows to the north."""
        x, y = np.meshgrid(*(np.arange(0, side + _LATTICE, _LATTICE) for side in self.extent))
        rng = np.random.default_rng(3)
        waves = zip(rng.uniform(60, 400, 12), rng.uniform(0, 2 * np.pi, 12), rng.uniform(0, 2 * np.pi, 12), strict=True)
        total = sum(
            0.012 * length * np.sin(2 * np.pi / length * (x * np.cos(way) + y * np.sin(way)) + phase)
            for length, way, phase in waves
        )
        return np.asarray(total, np.float32)

    @cached_property
    def orthoimage(self) -> np.ndarray:
        """Grey values (uint8), rows to the north; from the file where it was made before."""
        path = self.folder / f"land_{self.strips}x{self.per}.npy"
        if not path.exists():
            np.save(part := path.with_suffix(".part.npy"), self._painted())
            part.rename(path)
        return np.load(path, mmap_mode="r")

    def _painted(self) -> np.ndarray:
        cols, rows = (int(side / PIXEL) for side in self.extent)
        coarse = self._fields(rows // _COARSE + 2, cols // _COARSE + 2)
        grey = np.empty((rows, cols), np.uint8)
        for row in range(0, rows, _BAND):
            count = min(_BAND, rows - row)
            part = coarse[row // _COARSE : (row + count) // _COARSE + 1]
            light = cv2.resize(part, (cols, part.shape[0] * _COARSE), interpolation=cv2.INTER_LINEAR)[:count]
            for octave, step in enumerate((1.5, 3, 6, 12, 24)):
                noise = np.random.default_rng((5, row, octave)).standard_normal((int(count / step) + 2, int(cols / step) + 2))
                light = light + 5.0 * step**0.25 * cv2.resize(
                    noise.astype(np.float32), (cols, count), interpolation=cv2.INTER_CUBIC
                )
            grey[row : row + count] = np.clip(light, 0, 255)
        return grey

    def _fields(self, rows: int, cols: int) -> np.ndarray:
        """Fields of their own brightness and coarse noise, float32, one value for `_COARSE` pixels."""
        rng = np.random.default_rng(4)
        side = _COARSE * PIXEL
        seeds = rng.uniform((0, 0), (rows, cols), (int(rows * cols * (side / 45) ** 2) + 1, 2))
        places = np.stack(np.meshgrid(np.arange(rows), np.arange(cols), indexing="ij"), axis=-1)
        light = rng.uniform(80, 170, len(seeds))[cKDTree(seeds).query(places)[1]].astype(np.float32)
        for step in (2, 5, 12):
            noise = rng.standard_normal((rows // step + 2, cols // step + 2)).astype(np.float32)
            light += 6.0 * cv2.resize(noise, (cols, rows), interpolation=cv2.INTER_CUBIC)
        return light

    def grey(self, station: Station) -> np.ndarray:
        """The photograph (HEIGHT, WIDTH) float32 without noise."""
        x, y = np.meshgrid(np.arange(WIDTH) - (WIDTH - 1) / 2, (HEIGHT - 1) / 2 - np.arange(HEIGHT))
        ray = (np.stack([x, y, np.full(x.shape, -CONSTANT)], axis=-1) @ station.rotation).astype(np.float32)
        slope, centre = ray[..., :2] / -ray[..., 2:], station.centre.astype(np.float32)
        height = np.zeros(x.shape, np.float32)
        for _ in range(_STEPS):
            place = centre[:2] + slope * (centre[2] - height)[..., None]
            height = cv2.remap(self.heights, *_maps(place, _LATTICE), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        col, row = _maps(place, PIXEL)
        # Only the part that is seen: OpenCV would copy the whole orthoimage from its file.
        left, low = (max(0, int(values.min()) - 2) for values in (col, row))
        seen = np.ascontiguousarray(self.orthoimage[low : int(row.max()) + 3, left : int(col.max()) + 3])
        found = cv2.remap(seen, col - np.float32(left), row - np.float32(low), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return cv2.GaussianBlur(found.astype(np.float32), (0, 0), 0.6)


def _maps(place: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of places (..., 2) m in a raster of cells of `step` whose first row lies in the south."""
    return np.ascontiguousarray(place[..., 0] / np.float32(step)), np.ascontiguousarray(place[..., 1] / np.float32(step))


def write_photograph(land: Land, station: Station, folder: Path) -> None:
    """The photograph as JPEG with what a drone writes into EXIF; one that is there stays."""
    path = folder / f"{station.name}.jpg"
    if path.exists():
        return
    rng = np.random.default_rng((9, int(station.name[-4:])))
    grey = np.clip(land.grey(station) + rng.normal(0, 2.0, (HEIGHT, WIDTH)), 0, 255)
    colour = np.stack([grey, np.minimum(1.04 * grey, 255), 0.9 * grey], axis=-1).astype(np.uint8)
    part = path.with_suffix(".part")
    Image.fromarray(colour).save(part, "JPEG", quality=92, exif=_exif(station, rng))
    part.rename(path)


def _exif(station: Station, rng: np.random.Generator) -> Image.Exif:
    east, north, height = np.array(CORNER) + station.centre + rng.normal(0, _GNSS)
    longitude, latitude = Transformer.from_crs(CRS, "EPSG:4326", always_xy=True).transform(east, north)
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "Rolling", "Land 1"  # make, model
    exif[0x8769] = {
        0x920A: 8.8 * CONSTANT / WIDTH * 1.5,
        0xA405: round(36 * CONSTANT / WIDTH),
    }  # focal length, that of a 35 mm film
    exif[0x8825] = {1: "N", 2: _sexagesimal(latitude), 3: "E", 4: _sexagesimal(longitude), 5: b"\0", 6: float(height)}
    return exif


def _sexagesimal(degrees: float) -> tuple[float, float, float]:
    minutes = degrees % 1 * 60
    return float(int(degrees)), float(int(minutes)), round(minutes % 1 * 60, 6)
