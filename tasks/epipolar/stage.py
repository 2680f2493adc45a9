"""Epipolar images of every useful pair: first the pairs, then their images tile by tile.

A tile reads the window of the photograph that it shows and nothing else, so it can start as soon as those pixels are stored.
"""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.epipolar import PAIRS, EpipolarPair, EpipolarPairs, epipolar_raster, grey_table
from orthomill.schemas.job import Export, Job, Raster, Reading
from orthomill.schemas.observations import IMAGE_RESIDUALS, ImageResiduals
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photos, photo_raster
from orthomill.schemas.raster import RasterSpec, Tile, tiles_of
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.epipolar.epipolar_image import TileOfPair, photograph_range, resample_tile
from orthomill.tasks.epipolar.parallax import SIDES, matched_level, with_measured_rows
from orthomill.tasks.epipolar.report import report
from orthomill.tasks.epipolar.selection import PairChoice, choose_pairs
from orthomill.tasks.geometry.normal_case import Side, epipolar_shape


def measured_pairs(
    block: Block,
    measured: ImageResiduals,
    photos: Photos,
    choice: PairChoice,
    height_margin: float,
    height_room: float,
    level: int | None,
) -> EpipolarPairs:
    """The useful pairs (`choose_pairs`) with the rows that their tie points measured, on pyramid level `level`; None: on the finest
    one on which these agree."""
    coarsest = min(photos[name].levels for name in block.names) - 1

    def on(number: int) -> EpipolarPairs:
        pairs = choose_pairs(block, choice, height_margin, height_room, min(number, coarsest))
        return with_measured_rows(pairs, block, measured, photos.names)

    if level is not None:
        return on(level)
    fine = on(0)
    worth = matched_level(fine)
    return on(worth) if worth else fine


class EpipolarStage(Stage):
    """Normal-case images of the useful pairs: axes parallel, base along x, homologous points on one row, distortion removed."""

    title: ClassVar[str] = "Epipolar images"

    kind: Literal["epipolar"] = "epipolar"
    pairs: PairChoice = setting(PairChoice(), "Which pairs of photographs are used.")
    height_margin: float = setting(
        0.08, "How far the surface may exceed the heights of the tie points, as a share of the flying height.", ge=0, le=0.5
    )
    height_room: float = setting(
        25.0, "How far crowns and roofs may rise above the highest tie points, which lie mostly on the ground.", "m", ge=0
    )
    level: Literal["auto"] | Annotated[int, Field(ge=0, le=8)] = setting(
        "auto",
        "Level of the photographs that is matched: 0 as they are, 1 at half their size, 2 at a quarter; auto is the finest on "
        "which the rows of the pairs agree, so that photographs which do not fit together to a pixel still give a surface.",
    )
    interpolation: Literal["bicubic", "bilinear"] = setting("bicubic", "How photographs are resampled.")

    images: Literal["all", "none"] = setting(
        "all", "Whether the images are made, or pairs chosen only: the check of a surface from a file needs no more."
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        yield self._pairs_job()
        yield Job(
            stage=self.kind,
            item="report",
            function=report,
            reads={"block": BLOCK, "pairs": PAIRS, "measured": IMAGE_RESIDUALS, "photos": PHOTOS},
            writes={"report": report_table(self.kind)},
        )
        # The pairs decide which rasters exist, so the rest can only be planned once their job has run.
        pairs, block, photos = view.table(PAIRS), view.table(BLOCK), view.table(PHOTOS)
        yield from self._grey_ranges(view, photos, pairs.pairs)
        for pair in pairs.pairs if self.images == "all" else ():
            for side in SIDES:
                yield from self._image(pair, side, block, photos, view.project.tile)

    def _pairs_job(self) -> Job:
        """The choice of pairs, from the block and what its tie points say of the rows."""
        params = {
            "choice": self.pairs,
            "height_margin": self.height_margin,
            "height_room": self.height_room,
            "level": None if self.level == "auto" else self.level,
        }
        reads: dict[str, Reading] = {"block": BLOCK, "measured": IMAGE_RESIDUALS, "photos": PHOTOS}
        return Job(stage=self.kind, item="pairs", function=measured_pairs, reads=reads, writes={"pairs": PAIRS}, params=params)

    def _grey_ranges(self, view: ProjectView, photos: Photos, pairs: tuple[EpipolarPair, ...]) -> Iterator[Job]:
        """One stretch for each 16-bit photograph, from its coarsest level."""
        # 8-bit photographs keep their grey values: a stretch would only add rounding.
        for name in sorted({name for pair in pairs for name in (pair.left, pair.right)}):
            photo = photos[name]
            if photo.dtype != "uint8":
                coarsest = view.raster(photo_raster(name, photo.levels - 1))
                yield Job(
                    stage=self.kind,
                    item=f"grey-{name}",
                    function=photograph_range,
                    reads={"overview": Raster(coarsest.name, coarsest.full)},
                    writes={"grey": grey_table(name)},
                )

    def _image(self, pair: EpipolarPair, side: Side, block: Block, photos: Photos, size: int) -> Iterator[RasterSpec | Job]:
        shape = epipolar_shape(pair, side)
        yield RasterSpec(name=epipolar_raster(pair.name, side), shape=shape, dtype="uint8", chunk=size, nodata=0, unit="grey")
        for tile in tiles_of(shape, size):
            yield self._tile(pair, side, block, photos, tile)

    def _tile(self, pair: EpipolarPair, side: Side, block: Block, photos: Photos, tile: Tile) -> Job:
        photo = photos[pair.left if side == "left" else pair.right]
        of_pair = TileOfPair(pair, side, block.of(photo.name), block.camera_of(photo.name), tile.window)
        window = of_pair.source
        # A tile outside the photograph reads nothing but is still written: downstream jobs need the whole image.
        reads: dict[str, Reading] = {} if window.empty else {"pixels": Raster(photo_raster(photo.name, pair.level), window)}
        if reads and photo.dtype != "uint8":
            reads["stretch"] = grey_table(photo.name)
        return Job(
            stage=self.kind,
            item=f"{pair.name}-{side}",
            function=resample_tile,
            reads=reads,
            writes={"image": Raster(epipolar_raster(pair.name, side), tile.window)},
            params={"tile": of_pair, "photo_window": window, "bicubic": self.interpolation == "bicubic"},
            row=tile.row,
            col=tile.col,
            scratch=window.height * window.width * 30,
        )
