"""The jobs that make the coloured mesh: a block each in colour, coarser levels of four, and the files. No numerics beyond boxes."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from orthomill.schemas.job import Export, FileBytes, Job, Raster, Reading, Stream, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.solid.census import MeshTriangles, MeshVertices
from orthomill.tasks.colouring.sight.output_tile import ideal_part, photo_part, union_of
from orthomill.tasks.colouring.surface_colours import PROJECTION_RADIOMETRY, ColourRules
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth
from orthomill.tasks.geometry.photograph_part import PhotoPart, PhotoSource, photo_level
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.projection.chosen_photographs import PhotographMask
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
from orthomill.tasks.projection.projection_jobs import CENSUS, CORNERS, FACING, ProjectionBasis, block_window, photograph_layer
from orthomill.tasks.visibility.mesh_blocks import BlockBox, PhotoDepth, TileSurface
from orthomill.tasks.visibility.mesh_sight import SightTolerance

_TOGETHER = 4  # nodes below one
_PACKED = 2.2  # side of a texture over that of its triangles, laid out as a square: charts are no rectangles
_WHOLE = 32
"""blocks up to which all tiles also make one GLB: programs read it whole"""
_PAGE_BLOCKS = 32
"""blocks of the level that the page shows: half a million triangles"""


class NoModel(Settings):
    """No coloured mesh is made."""

    kind: Literal["none"]


class TexturedModel(Settings):
    """The mesh with a texture for each part of it, from every photograph that sees it; coarser levels where it is large."""

    kind: Literal["tiles"] = "tiles"
    texel: Annotated[float, Field(gt=0)] | Literal["auto"] = setting(
        "auto", "Side of a texel. auto: that of a pixel of the photographs on the surface.", "m"
    )
    side: int = setting(
        2048,
        "Longest side of a texture; where it does not suffice for 16384 triangles, their texels are larger.",
        "px",
        ge=64,
        le=8192,
    )


Model = Annotated[NoModel | TexturedModel, Field(discriminator="kind")]


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
        ideal = [ideal_part(basis.views[name], surface, basis.ideal[name], basis.origin) for name in basis.names]
        parts = tuple(part for part in ideal if part is not None)
        inner = [(part.name, part.window.within(basis.ideal[part.name])) for part in parts]
        numbers = union_of([(number,), *(self.seen[name].blocks_in(window) for name, window in inner)])
        shown = {part.name for part in parts} & set(self.masks)
        masked = tuple(part for part in self._parts(surface, 0.0) if part.name in shown)
        coloured = self._parts(surface, self.texel)
        reads: dict[str, Reading] = {
            "blocks": tuple(Raster(CORNERS, block_window(k)) for k in numbers),
            "nearness": tuple(Raster(photograph_layer(name, "nearness"), window) for name, window in inner),
            "drawn": tuple(Raster(photograph_layer(name, "triangle"), window) for name, window in inner),
            "photos": tuple(Raster(photo_raster(part.name, part.level), part.window) for part in coloured),
            "block": BLOCK,
            "census": CENSUS,
            "facing": FACING,
            "radiometry": PROJECTION_RADIOMETRY,
        }
        if widening:
            reads["widening"] = widening
        if masked:
            reads["masks"] = tuple(self.masks[part.name].region(part.window) for part in masked)
        side = self._side(number)
        tile = TexturedBlock(
            number=number,
            blocks=numbers,
            seen=PhotographSet(basis.names, parts, masked),
            coloured=PhotographSet(basis.names, coloured),
            side=side,
            texel=self.texel,
            extras=self.extras,
        )
        return Job(
            "projection",
            f"model-{number}",
            coloured_block,
            reads,
            {"tile": tile_table(0, number), "corners": corners_table(0, number), "facts": facts_table(number)},
            {"tile": tile, "tolerance": tolerance, "rules": rules},
            scratch=40 * side**2 + (400 + 40 * len(parts)) * TOGETHER + len(numbers) * 2**20 + 16 * 2**20,
        )

    def _side(self, number: int) -> int:
        """The side of a block's texture, a power of two."""
        wanted = _PACKED * sqrt(self.basis.blocks.areas[number]) / self.texel
        side = 64
        while 2 * side <= self.side and side < wanted:
            side *= 2
        return side

    def _parts(self, surface: TileSurface, pixel: float) -> tuple[PhotoPart, ...]:
        """The parts of photographs, at the level with pixels of about `pixel` m, that show a block."""
        middle = 0.5 * np.add(surface.low, surface.high) + self.basis.origin
        found = []
        for name, view in self.basis.views.items():
            photo = self.basis.photos[name]
            level = photo_level(pixel, float(np.linalg.norm(middle - view.centre)) / view.camera.c, photo.levels)
            source = PhotoSource(view, level, level_shape((photo.height, photo.width), level))
            found.append(photo_part(source, surface, self.basis.origin))
        return tuple(part for part in found if part is not None)

    def _level(self, level: int) -> Iterator[Job]:
        below, cell = self.counts[level - 1], self.cell(level)
        cells = Table(f"projection/model/cells/{level}.parquet", MeanCells)
        every = Stream(tuple(corners_table(level - 1, k) for k in range(below)))
        scratch = 600 * (self.basis.census.triangles // _TOGETHER**level + 2**16)
        yield Job("projection", f"cells-{level}", mean_cells, {"parts": every}, {"cells": cells}, {"cell": cell}, scratch=scratch)
        for number in range(self.counts[level]):
            children = range(_TOGETHER * number, min(_TOGETHER * (number + 1), below))
            yield Job(
                "projection",
                f"level-{level}-{number}",
                coarse_node,
                {"children": tuple(corners_table(level - 1, k) for k in children), "cells": cells, "facing": FACING},
                {"tile": tile_table(level, number), "corners": corners_table(level, number)},
                {"cell": cell, "extras": self.extras},
                scratch=64 * 2**20,
            )

    def _files(self) -> Iterator[Job | Export]:
        blocks, census = self.counts[0], self.basis.census
        ply, page = Table("projection/model/model.parquet", FileBytes), Table("projection/model/page.json", PageText)
        tree, whole = Table("projection/model/tileset.json", PageText), Table("projection/model/whole.parquet", FileBytes)
        mesh: dict[str, Reading] = {
            "vertices": Table("projection/vertices.parquet", MeshVertices),
            "triangles": Table("projection/triangles.parquet", MeshTriangles),
            "census": CENSUS,
            "facing": FACING,
            "corners": Stream(tuple(corners_table(0, k) for k in range(blocks))),
        }
        crs = {"crs": self.basis.crs}
        # The sums of colours, the file, and what packs it for the disk.
        scratch = 130 * census.vertices + 90 * census.triangles
        yield Job("projection", "model-ply", coloured_ply, mesh, {"ply": ply}, crs, scratch=scratch)
        yield Export("projection", "model_ply", "products/model.ply", "bytes", tables=(ply,))
        shown = next(level for level, count in enumerate(self.counts) if count <= _PAGE_BLOCKS)
        tiles = Stream(tuple(tile_table(shown, k) for k in range(self.counts[shown])))
        reads: dict[str, Reading] = {"tiles": tiles, "block": BLOCK, "census": CENSUS}
        params = {"names": self.basis.names, "title": self.project}
        yield Job("projection", "model-page", view_page, reads, {"page": page}, params, scratch=512 * 2**20)
        yield Export("projection", "model_page", "products/model.html", "text", tables=(page,))
        nodes = {"root": self._tree(len(self.counts) - 1, 0), **crs}
        yield Job("projection", "model-tree", tileset, {"census": CENSUS}, {"tileset": tree}, nodes)
        yield Export("projection", "model_tileset", "products/model/tileset.json", "text", tables=(tree,))
        if self.is_whole:
            every = Stream(tuple(tile_table(0, k) for k in range(blocks)))
            size = blocks * 3 * self.side**2
            yield Job("projection", "model-glb", whole_glb, {"tiles": every}, {"glb": whole}, {"extras": self.extras}, scratch=size)
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
        low = np.min([child.box.low for child in children], axis=0).tolist()
        high = np.max([child.box.high for child in children], axis=0).tolist()
        return TreeNode(tile_path(level, number), BlockBox(low=tuple(low), high=tuple(high)), self.cell(level), children)
