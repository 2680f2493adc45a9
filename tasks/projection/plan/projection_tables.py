"""Under which names the stage `projection` keeps its rasters and tables."""

from orthomill.schemas.job import Raster, Table
from orthomill.schemas.raster import Tile, Window
from orthomill.schemas.solid.census import MeshCensus, MeshTriangles, MeshVertices
from orthomill.schemas.solid.frames import OutputFrames
from orthomill.tasks.colouring.balance.shared_ground import Samples
from orthomill.tasks.colouring.plan.balance_jobs import radiometry_table
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth, HiddenEdges
from orthomill.tasks.projection.photographs.border_masks import BorderFacts
from orthomill.tasks.projection.photographs.leave_one_out import LeftOutPhotograph
from orthomill.tasks.projection.tiles.output_colours import ProjectionTile
from orthomill.tasks.projection.tiles.width_trials import WidthTrial
from orthomill.tasks.visibility.mesh_blocks import MeshBlocks, PhotoDepth, ShownSurfaces, TileSurface
from orthomill.tasks.visibility.triangle_blocks import SIDE

VERTICES = Table("projection/vertices.parquet", MeshVertices)
TRIANGLES = Table("projection/triangles.parquet", MeshTriangles)
CORNERS = "projection/corners"
"""float32 (128 per block, 128, 9): the corners of all triangles, m relative to the mesh's origin"""
CENSUS = Table("projection/census.json", MeshCensus)
BLOCKS = Table("projection/blocks.json", MeshBlocks)
FRAMES = Table("projection/frames.json", OutputFrames)
FACING = Table("projection/facing.json", MeshFacing)
SURFACES = Table("projection/surfaces.json", ShownSurfaces)
RADIOMETRY = radiometry_table("projection")
WIDENING = Table("projection/widening.json", ChosenWidth)


def block_window(number: int) -> Window:
    """A block in the raster of corners."""
    return Window(number * SIDE, 0, SIDE, SIDE)


def mesh_blocks(numbers: tuple[int, ...]) -> tuple[Raster, ...]:
    """Blocks of the mesh."""
    return tuple(Raster(CORNERS, block_window(number)) for number in numbers)


def depth_table(name: str) -> Table[PhotoDepth]:
    """What a photograph shows of the mesh."""
    return Table(f"projection/photographs/{name}.json", PhotoDepth)


def photograph_layer(name: str, layer: str) -> str:
    """A raster of a photograph: nearness, triangle."""
    return f"projection/photographs/{name}/{layer}"


def border_layer(name: str) -> str:
    """The mask of a photograph's black border."""
    return photograph_layer(name, "border")


def border_table(name: str) -> Table[BorderFacts]:
    """How much of a photograph is black border."""
    return Table(f"projection/borders/{name}.json", BorderFacts)


def output_layer(name: str, layer: str) -> str:
    """A raster of an output: nearness, triangle, sight, ortho, coverage, rejected."""
    return f"projection/{name}/{layer}"


def zones_layer(name: str, photo: str) -> str:
    """The zones of a photograph next to the limits of what it does not see of an output."""
    return output_layer(name, f"limits/{photo}")


def surface_table(name: str, tile: Tile) -> Table[TileSurface]:
    """What a tile of an output shows of the mesh."""
    return Table(f"projection/surface/{name}/{tile.row}-{tile.col}.json", TileSurface)


def samples_table(name: str, tile: Tile) -> Table[Samples]:
    """Samples of a tile of an output for the balance."""
    return Table(f"projection/samples/{name}/{tile.row}-{tile.col}.parquet", Samples)


def statistics_table(name: str, tile: Tile) -> Table[ProjectionTile]:
    """Sums over a tile of an output."""
    return Table(f"projection/statistics/{name}/{tile.row}-{tile.col}.json", ProjectionTile)


def edges_table(name: str, tile: Tile) -> Table[HiddenEdges]:
    """Edges of what is hidden in a tile of an output."""
    return Table(f"projection/edges/{name}/{tile.row}-{tile.col}.parquet", HiddenEdges)


def trial_table(name: str, tile: Tile) -> Table[WidthTrial]:
    """What a tile of an output tells of the widths."""
    return Table(f"projection/widths/{name}/{tile.row}-{tile.col}.json", WidthTrial)


def left_out_table(name: str) -> Table[LeftOutPhotograph]:
    """The comparison of a photograph that was left out."""
    return Table(f"projection/{name}.json", LeftOutPhotograph)
