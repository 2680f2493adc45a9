"""The jobs that make the coloured mesh: a block each in colour, coarser levels of four, and the files. No numerics beyond boxes."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Any

from orthomill.schemas.job import Export, FileBytes, Job, Reading, Stream, Table
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.plan.balance_jobs import photo_pixels
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth
from orthomill.tasks.projection.model.model_colours import (
    TOGETHER,
    ColouredCorners,
    PhotographSet,
    TexturedBlock,
    TileFacts,
    coloured_block,
)
from orthomill.tasks.projection.model.model_files import PageText, TreeNode, coloured_ply, tileset, view_page, whole_glb
from orthomill.tasks.projection.model.model_levels import MeanCells, coarse_node, mean_cells
from orthomill.tasks.projection.photographs.chosen_photographs import PhotographMask
from orthomill.tasks.projection.plan.projection_tables import CENSUS, FACING, RADIOMETRY, TRIANGLES, VERTICES, mesh_blocks
from orthomill.tasks.projection.plan.sight_regions import sight_regions
from orthomill.tasks.projection.projection_basis import ProjectionBasis
from orthomill.tasks.visibility.mesh_blocks import PhotoDepth, TileSurface, box_about
from orthomill.tasks.visibility.mesh_sight import SightTolerance

_TOGETHER = 4  # nodes below one
_PACKED = 2.2  # side of a texture over that of its triangles, laid out as a square: charts are no rectangles
_WHOLE = 32
"""blocks up to which all tiles also make one GLB: programs read it whole"""
_PAGE_BLOCKS = 32
"""blocks of the level that the page shows: half a million triangles"""


def tile_table(level: int, number: int) -> Table[FileBytes]:
    """A tile of the model as GLB; level 0 is the mesh itself."""
    return Table(f"projection/model/{level}-{number}.parquet", FileBytes)


def corners_table(level: int, number: int) -> Table[ColouredCorners]:
    """The triangles of a tile with colours."""
    return Table(f"projection/model/corners/{level}-{number}.parquet", ColouredCorners)


def facts_table(number: int) -> Table[TileFacts]:
    """What the texture of a block is worth."""
    return Table(f"projection/model/facts/{number}.json", TileFacts)


def tile_path(level: int, number: int) -> str:
    """The file of a tile, in the folder of the tileset."""
    return f"tiles/{level}-{number}.glb"


@dataclass(frozen=True, eq=False)
class ModelJobs:
    """`texel` m as wanted, `side` at most; `seen`: what photographs show; `masks`: by photograph."""

    basis: ProjectionBasis
    seen: dict[str, PhotoDepth]
    masks: dict[str, PhotographMask]
    texel: float
    side: int
    project: str

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Tiles by level, from fine to coarse; the last level has one."""
        out = [len(self.basis.blocks.boxes)]
        while out[-1] > 1:
            out.append(-(-out[-1] // _TOGETHER))
        return tuple(out)

    @property
    def extras(self) -> dict[str, Any]:
        """What a file says of its coordinates."""
        return {"crs": self.basis.crs, "origin": list(self.basis.census.origin), "unit": "m"}

    def cell(self, level: int) -> float:
        """Side of the cells of a level, m, whose triangles are a quarter of those of the level before."""
        wanted = self.basis.census.triangles / _TOGETHER**level
        return sqrt(2.0 * sum(self.basis.blocks.areas) / max(wanted, 1.0))

    def jobs(self, tolerance: SightTolerance, rules: ColourRules, widening: Table[ChosenWidth] | None) -> Iterator[Job | Export]:
        """All of them."""
        for number in range(self.counts[0]):
            yield self._block(number, tolerance, rules, widening)
        for level in range(1, len(self.counts)):
            yield from self._level(level)
        yield from self._files()
        for level, count in enumerate(self.counts):
            for number in range(count):
                path = f"products/model/{tile_path(level, number)}"
                yield Export("projection", f"model-{level}-{number}", path, "bytes", tables=(tile_table(level, number),))

    def facts(self) -> tuple[Table[TileFacts], ...]:
        """What the textures are worth."""
        return tuple(facts_table(number) for number in range(self.counts[0]))

    def _block(self, number: int, tolerance: SightTolerance, rules: ColourRules, widening: Table[ChosenWidth] | None) -> Job:
        basis, box = self.basis, self.basis.blocks.boxes[number]
        surface = TileSurface(covered=1, blocks=(number,), low=box.low, high=box.high)
        middle = basis.middle_of(surface)
        full = basis.photo_parts(basis.names, surface, middle, 0.0)
        coloured = basis.photo_parts(basis.names, surface, middle, self.texel)
        regions = sight_regions(basis, basis.names, surface, self.seen, self.masks, full)
        reads: dict[str, Reading] = {
            "blocks": mesh_blocks(regions.blocks),
            "nearness": regions.rasters("nearness"),
            "drawn": regions.rasters("triangle"),
            "photos": photo_pixels(coloured),
            "block": BLOCK,
            "census": CENSUS,
            "facing": FACING,
            "radiometry": RADIOMETRY,
        }
        if widening:
            reads["widening"] = widening
        if regions.masks:
            reads["masks"] = regions.masks
        side, colours = self._side(number), array_bytes(400 + 40 * len(regions.parts), TOGETHER)
        tile = TexturedBlock(
            number=number,
            blocks=regions.blocks,
            seen=PhotographSet(basis.names, regions.parts, regions.masked),
            coloured=PhotographSet(basis.names, coloured),
            side=side,
            texel=self.texel,
            extras=self.extras,
        )
        return Job(
            stage="projection",
            item=f"model-{number}",
            function=coloured_block,
            reads=reads,
            writes={"tile": tile_table(0, number), "corners": corners_table(0, number), "facts": facts_table(number)},
            params={"tile": tile, "tolerance": tolerance, "rules": rules},
            scratch=array_bytes(40, side, side) + colours + (len(regions.blocks) + 16) * MIB,
        )

    def _side(self, number: int) -> int:
        """The side of a block's texture, a power of two."""
        wanted = _PACKED * sqrt(self.basis.blocks.areas[number]) / self.texel
        side = 64
        while 2 * side <= self.side and side < wanted:
            side *= 2
        return side

    def _level(self, level: int) -> Iterator[Job]:
        below, cell = self.counts[level - 1], self.cell(level)
        cells = Table(f"projection/model/cells/{level}.parquet", MeanCells)
        yield Job(
            stage="projection",
            item=f"cells-{level}",
            function=mean_cells,
            reads={"parts": Stream(tuple(corners_table(level - 1, k) for k in range(below)))},
            writes={"cells": cells},
            params={"cell": cell},
            scratch=array_bytes(600, self.basis.census.triangles // _TOGETHER**level + 2**16),
        )
        for number in range(self.counts[level]):
            children = range(_TOGETHER * number, min(_TOGETHER * (number + 1), below))
            yield Job(
                stage="projection",
                item=f"level-{level}-{number}",
                function=coarse_node,
                reads={"children": tuple(corners_table(level - 1, k) for k in children), "cells": cells, "facing": FACING},
                writes={"tile": tile_table(level, number), "corners": corners_table(level, number)},
                params={"cell": cell, "extras": self.extras},
                scratch=64 * MIB,
            )

    def _files(self) -> Iterator[Job | Export]:
        yield from self._ply()
        yield from self._page()
        yield from self._tileset()
        if self.is_whole:
            yield from self._glb()

    def _ply(self) -> Iterator[Job | Export]:
        census, ply = self.basis.census, Table("projection/model/model.parquet", FileBytes)
        yield Job(
            stage="projection",
            item="model-ply",
            function=coloured_ply,
            reads={
                "vertices": VERTICES,
                "triangles": TRIANGLES,
                "census": CENSUS,
                "facing": FACING,
                "corners": Stream(tuple(corners_table(0, k) for k in range(self.counts[0]))),
            },
            writes={"ply": ply},
            params={"crs": self.basis.crs},
            # The sums of colours, the file, and what packs it for the disk.
            scratch=array_bytes(130, census.vertices) + array_bytes(90, census.triangles),
        )
        yield Export("projection", "model_ply", "products/model.ply", "bytes", tables=(ply,))

    def _page(self) -> Iterator[Job | Export]:
        page = Table("projection/model/page.json", PageText)
        shown = next(level for level, count in enumerate(self.counts) if count <= _PAGE_BLOCKS)
        yield Job(
            stage="projection",
            item="model-page",
            function=view_page,
            reads={
                "tiles": Stream(tuple(tile_table(shown, k) for k in range(self.counts[shown]))),
                "block": BLOCK,
                "census": CENSUS,
            },
            writes={"page": page},
            params={"names": self.basis.names, "title": self.project},
            scratch=512 * MIB,
        )
        yield Export("projection", "model_page", "products/model.html", "text", tables=(page,))

    def _tileset(self) -> Iterator[Job | Export]:
        tree = Table("projection/model/tileset.json", PageText)
        yield Job(
            stage="projection",
            item="model-tree",
            function=tileset,
            reads={"census": CENSUS},
            writes={"tileset": tree},
            params={"root": self._tree(len(self.counts) - 1, 0), "crs": self.basis.crs},
        )
        yield Export("projection", "model_tileset", "products/model/tileset.json", "text", tables=(tree,))

    def _glb(self) -> Iterator[Job | Export]:
        whole = Table("projection/model/whole.parquet", FileBytes)
        yield Job(
            stage="projection",
            item="model-glb",
            function=whole_glb,
            reads={"tiles": Stream(tuple(tile_table(0, k) for k in range(self.counts[0])))},
            writes={"glb": whole},
            params={"extras": self.extras},
            scratch=array_bytes(3, self.counts[0], self.side**2),
        )
        yield Export("projection", "model_glb", "products/model.glb", "bytes", tables=(whole,))

    @property
    def is_whole(self) -> bool:
        """Whether all tiles are also one GLB."""
        return self.counts[0] <= _WHOLE

    def _tree(self, level: int, number: int) -> TreeNode:
        if level == 0:
            return TreeNode(tile_path(0, number), self.basis.blocks.boxes[number], 0.0)
        below = range(_TOGETHER * number, min(_TOGETHER * (number + 1), self.counts[level - 1]))
        children = tuple(self._tree(level - 1, k) for k in below)
        return TreeNode(tile_path(level, number), box_about([child.box for child in children]), self.cell(level), children)
