"""The jobs of the stage `photos`: the table of the photographs, their pixels by strips, their pyramids and their exposure.

Pixels are read in strips of entire chunks, a tile high (or a tile wide for photographs that EXIF rotates by a quarter turn, whose
file rows become columns), so that a strip bounds the memory however large the photograph. A JPEG or PNG is decoded from its first
row on, whichever row is wanted: its strips are as high as memory allows, most often the whole photograph.
"""

from collections.abc import Iterator
from typing import Any

from orthomill.schemas.job import Export, Job, PhotoHeader, PhotoPicture, PhotoPixels, Raster, Region, Table, TextFile
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.photo import PHOTOS, Photo, Soundness, photo_raster
from orthomill.schemas.project import MaskFiles
from orthomill.schemas.raster import RasterSpec, Window, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.geometry.reference_system import ground_crs
from orthomill.tasks.imagery.pyramid import level_shape, source_window
from orthomill.tasks.imagery.upright import file_window, turned, upright_shape
from orthomill.tasks.photos.index import Limits, index_photos
from orthomill.tasks.photos.pixels import Exposure, exposure, level_tile, picture_soundness, upright_strip
from orthomill.tasks.photos.report.photos_report import photos_report
from orthomill.tasks.photos.scans import Scans, scan_tile, scan_window
from orthomill.tasks.photos.stage import PhotosStage

KIND = "photos"
AT_ONCE = 96 * MIB
"""Bytes of a strip of a photograph that is decoded in order; a job takes four times as many, a worker of 1 GiB has room for it."""
SCANS = Table("photos/scans.json", Scans)


def exposure_table(photo: str) -> Table[Exposure]:
    """The table that holds the exposure of a photograph."""
    return Table(f"photos/exposure/{photo}.json", Exposure)


def photo_jobs(asked: PhotosStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """The table of photographs first, then their strips, levels and exposure."""
    ground_crs(view.project.crs)
    source = view.project.photographs
    paths = view.image_files(source)
    masks = () if source.kind == "simulated" or source.masks is None else view.image_files(MaskFiles(path=source.masks))
    for number, path in enumerate(paths):
        picture, soundness = {"picture": PhotoPicture(path)}, {"soundness": _soundness(number)}
        yield Job(stage=KIND, item="pictures", function=picture_soundness, reads=picture, writes=soundness, row=number)
    yield _index_job(asked, view, paths, tuple(sorted(set(masks) - set(paths))))
    # Sizes and numbers of levels are known when the headers have been read: planning continues from here when they are.
    photos = view.table(PHOTOS)
    for photo in photos.photos:
        yield from _pixel_jobs(photo, view.project.tile)
    yield Job(
        stage=KIND,
        item="report",
        function=photos_report,
        reads={"photos": PHOTOS, "scans": SCANS, "exposures": tuple(exposure_table(name) for name in photos.names)},
        writes={"report": report_table(KIND)},
        params={"positions_kind": view.project.positions.kind, "cameras_kind": view.project.cameras.kind},
    )


def _index_job(asked: PhotosStage, view: ProjectView, paths: tuple[str, ...], masks: tuple[str, ...]) -> Job:
    headers, pictures = tuple(PhotoHeader(path) for path in paths), tuple(map(_soundness, range(len(paths))))
    texts = tuple(TextFile(path) for path in asked.coordinates.files)
    reads: dict[str, Region | tuple[Region, ...]] = {"headers": headers, "pictures": pictures, "scan_texts": texts}
    reads |= {"masks": tuple(map(PhotoHeader, masks))} if masks else {}
    reads |= _positions_file(view)
    params: dict[str, Any] = {
        "crs": view.project.crs,
        "positions": view.project.positions,
        "limits": Limits(asked.max_megapixels, band=getattr(view.project.photographs, "band", None)),
        "coordinates": asked.coordinates,
    }
    writes: dict[str, Raster | Table] = {"photos": PHOTOS, "scans": SCANS}
    return Job(stage=KIND, item="index", function=index_photos, reads=reads, writes=writes, params=params)


def _pixel_jobs(photo: Photo, tile: int) -> Iterator[RasterSpec | Job]:
    for level in range(photo.levels):
        yield _level_spec(photo, level, tile)
    yield from _strip_jobs(photo, tile) if photo.scan is None else _scan_jobs(photo, tile)
    for level in range(1, photo.levels):
        yield from _level_jobs(photo, level, tile)
    top = _level_spec(photo, photo.levels - 1, tile)
    yield Job(
        stage=KIND,
        item=f"{photo.name} exposure",
        function=exposure,
        reads={"overview": Raster(top.name, top.full)},
        writes={"exposure": exposure_table(photo.name)},
        params={"photo": photo.name},
        scratch=array_bytes(16, top.shape[:2]),  # bytes: the grey values and two temporary arrays, float32
    )


def _strip_jobs(photo: Photo, tile: int) -> Iterator[Job]:
    name = photo_raster(photo.name)
    in_file = upright_shape(photo.exif_orientation, photo.height, photo.width)
    for index, window in enumerate(_strips(photo, tile)):
        in_window = file_window(window, photo.exif_orientation, *in_file)
        mask = {"mask": PhotoPixels(photo.mask, window if photo.mask_upright else in_window)} if photo.mask else {}
        yield Job(
            stage=KIND,
            item=f"{photo.name} strip",
            row=index,
            function=upright_strip,
            reads={"pixels": PhotoPixels(photo.path, in_window), **mask},
            writes={"strip": Raster(name, window)},
            params=_orientations(photo),
            # As much for a copy that is turned, or for what a decoder holds that needs all rows: the coefficients of a
            # progressive JPEG have 16 bits.
            scratch=array_bytes(2, window, photo.stored_bands),
            remedy=f"save {photo.path} as a tiled TIFF or, if it is a progressive JPEG or an interlaced PNG, as a plain one",
        )


def _scan_jobs(photo: Photo, tile: int) -> Iterator[Job]:
    """The tiles of a scan in the frame of its marks, each from the part of the file that it needs."""
    spec = _level_spec(photo, 0, tile)
    for cell in tiles_of(spec.shape, tile):
        source = scan_window(photo, cell.window)
        yield Job(
            stage=KIND,
            item=f"{photo.name} scan",
            row=cell.row,
            col=cell.col,
            function=scan_tile,
            # The frame is a rectangle around the marks, the scan may end before it: such tiles read nothing and are black.
            reads={} if source.empty else {"pixels": PhotoPixels(photo.path, source), **_scan_mask(photo, source)},
            writes={"tile": Raster(spec.name, cell.window)},
            params={"photo": photo, "window": cell.window, "source": source},
            scratch=array_bytes(16, source, photo.stored_bands) + array_bytes(48, tile, tile, photo.stored_bands),
        )


def _orientations(photo: Photo) -> dict[str, int]:
    own = {"orientation": photo.exif_orientation}
    return own | ({"mask_orientation": 1 if photo.mask_upright else photo.exif_orientation} if photo.mask else {})


def _scan_mask(photo: Photo, source: Window) -> dict[str, PhotoPixels]:
    return {"mask": PhotoPixels(photo.mask, source)} if photo.mask else {}


def _level_jobs(photo: Photo, level: int, tile: int) -> Iterator[Job]:
    below, spec = _level_spec(photo, level - 1, tile), _level_spec(photo, level, tile)
    for cell in tiles_of(spec.shape, tile):
        yield Job(
            stage=KIND,
            item=f"{photo.name} level {level}",
            row=cell.row,
            col=cell.col,
            function=level_tile,
            reads={"pixels": Raster(below.name, source_window(cell.window, below.shape))},
            writes={"tile": Raster(spec.name, cell.window)},
            params={"window": cell.window},
            scratch=array_bytes(64, tile, tile, photo.stored_bands),
        )


def _soundness(number: int) -> Table[Soundness]:
    """Whether the picture of a file is whole, by its number among the files: their paths may lead out of the folder of tables."""
    return Table(f"photos/whole/{number}.json", Soundness)


def _positions_file(view: ProjectView) -> dict[str, Region]:
    positions = view.project.positions
    if positions.kind == "file":
        return {"positions_text": TextFile(positions.path)}
    if positions.kind == "simulated":
        return {"positions_text": TextFile(view.run_file("photographs/positions.csv"))}
    return {}


def _level_spec(photo: Photo, level: int, tile: int) -> RasterSpec:
    shape = level_shape((photo.height, photo.width, photo.stored_bands), level)
    return RasterSpec(name=photo_raster(photo.name, level), shape=shape, dtype=photo.dtype, chunk=tile)


def _strips(photo: Photo, tile: int) -> Iterator[Window]:
    """Strips of entire chunks of the upright photograph that are rows of its file."""
    # Compressed files decode row by row: a strip across the file's rows would decode the whole file for every strip.
    if turned(photo.exif_orientation):
        side = _strip_side(photo, photo.height, tile)
        for col in range(0, photo.width, side):
            yield Window(0, col, photo.height, min(side, photo.width - col))
    else:
        side = _strip_side(photo, photo.width, tile)
        for row in range(0, photo.height, side):
            yield Window(row, 0, min(side, photo.height - row), photo.width)


def _strip_side(photo: Photo, length: int, tile: int) -> int:
    """Rows of the file in one strip, each `length` px long."""
    if photo.decoding == "anywhere":
        return tile
    if photo.decoding == "at_once":
        return max(photo.height, photo.width)
    row = length * photo.stored_bands * (2 if photo.dtype == "uint16" else 1)
    return max(1, AT_ONCE // (row * tile)) * tile
