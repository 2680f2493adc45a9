"""Epipolar images of every useful pair: first the pairs, then their images tile by tile.

A tile reads the window of the photograph that it shows and nothing else, so it can start as soon as those pixels are stored.
"""

from collections.abc import Iterator

from orthomill.schemas.epipolar import PAIRS, EpipolarPair, epipolar_raster, grey_table
from orthomill.schemas.job import AreaFile, Export, Job, Raster, Reading
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.observations import IMAGE_RESIDUALS
from orthomill.schemas.orientation import BLOCK, Area, Block
from orthomill.schemas.photo import PHOTOS, Photos, photo_raster
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import RasterSpec, Tile, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.epipolar.epipolar_image import TileOfPair, photograph_range, resample_tile
from orthomill.tasks.epipolar.measured_pairs import measured_pairs
from orthomill.tasks.epipolar.parallax import SIDES
from orthomill.tasks.epipolar.report.epipolar_report import report
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.geometry.normal_case import Side, epipolar_shape


def epipolar_jobs(asked: EpipolarStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """The choice of the pairs and its report; once they are chosen, their images."""
    yield _pairs_job(asked, view)
    yield Job(
        stage=asked.kind,
        item="report",
        function=report,
        reads={"block": BLOCK, "pairs": PAIRS, "measured": IMAGE_RESIDUALS, "photos": PHOTOS},
        writes={"report": report_table(asked.kind)},
    )
    # The pairs decide which rasters exist, so the rest can only be planned once their job has run.
    pairs, block, photos = view.table(PAIRS), view.table(BLOCK), view.table(PHOTOS)
    yield from _grey_ranges(asked, view, photos, pairs.pairs)
    for pair in pairs.pairs if asked.images == "all" else ():
        for side in SIDES:
            yield from _image(asked, pair, side, block, photos, view.project.tile)


def _pairs_job(asked: EpipolarStage, view: ProjectView) -> Job:
    """The choice of pairs, from the block and what its tie points say of the rows."""
    params = {
        "choice": asked.pairs,
        "height_margin": asked.height_margin,
        "height_room": asked.height_room,
        "level": None if asked.level == "auto" else asked.level,
        "area": _area(view),
    }
    reads: dict[str, Reading] = {"block": BLOCK, "measured": IMAGE_RESIDUALS, "photos": PHOTOS}
    if file := view.project.grid.area_file:
        reads["wanted"] = AreaFile(file, view.project.crs)
    return Job(stage=asked.kind, item="pairs", function=measured_pairs, reads=reads, writes={"pairs": PAIRS}, params=params)


def _area(view: ProjectView) -> Area | None:
    """Where on the map the surface is wanted; None: everywhere, or on a plane."""
    ground = view.project.grid
    return ground.area if isinstance(ground, MapSurface) and isinstance(ground.area, tuple) else None


def _grey_ranges(asked: EpipolarStage, view: ProjectView, photos: Photos, pairs: tuple[EpipolarPair, ...]) -> Iterator[Job]:
    """One stretch for each 16-bit photograph, from its coarsest level."""
    # 8-bit photographs keep their grey values: a stretch would only add rounding.
    for name in sorted({name for pair in pairs for name in (pair.left, pair.right)}):
        photo = photos[name]
        if photo.dtype != "uint8":
            coarsest = view.raster(photo_raster(name, photo.levels - 1))
            yield Job(
                stage=asked.kind,
                item=f"grey-{name}",
                function=photograph_range,
                reads={"overview": Raster(coarsest.name, coarsest.full)},
                writes={"grey": grey_table(name)},
            )


def _image(
    asked: EpipolarStage, pair: EpipolarPair, side: Side, block: Block, photos: Photos, size: int
) -> Iterator[RasterSpec | Job]:
    shape = epipolar_shape(pair, side)
    yield RasterSpec(name=epipolar_raster(pair.name, side), shape=shape, dtype="uint8", chunk=size, nodata=0, unit="grey")
    for tile in tiles_of(shape, size):
        yield _tile(asked, pair, side, block, photos, tile)


def _tile(asked: EpipolarStage, pair: EpipolarPair, side: Side, block: Block, photos: Photos, tile: Tile) -> Job:
    photo = photos[pair.left if side == "left" else pair.right]
    of_pair = TileOfPair(pair, side, block.of(photo.name), block.camera_of(photo.name), tile.window)
    window = of_pair.source
    # A tile outside the photograph reads nothing but is still written: downstream jobs need the whole image.
    reads: dict[str, Reading] = {} if window.empty else {"pixels": Raster(photo_raster(photo.name, pair.level), window)}
    if reads and photo.dtype != "uint8":
        reads["stretch"] = grey_table(photo.name)
    return Job(
        stage=asked.kind,
        item=f"{pair.name}-{side}",
        function=resample_tile,
        reads=reads,
        writes={"image": Raster(epipolar_raster(pair.name, side), tile.window)},
        params={"tile": of_pair, "photo_window": window, "bicubic": asked.interpolation == "bicubic"},
        row=tile.row,
        col=tile.col,
        scratch=array_bytes(30, window),
    )
