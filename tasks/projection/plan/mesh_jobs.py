"""The jobs of the surface itself: its mesh, the blocks of it, the frames of the outputs, which way it faces, lines on it."""

from collections.abc import Iterator
from typing import Literal

from orthomill.schemas.job import Export, Job, MeshFile, Raster, Stream, Table
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.surface import CORRECTED, HEIGHT, SURFACE
from orthomill.tasks.colouring.sight.facing import mesh_facing
from orthomill.tasks.projection.frames.projection_frames import output_frames
from orthomill.tasks.projection.lines.section_line import LineText, SectionLine, draw_section
from orthomill.tasks.projection.mesh.depth_rasters import cut_into_blocks
from orthomill.tasks.projection.mesh.mesh_mending import mend_heights, mend_mesh
from orthomill.tasks.projection.outputs import Output
from orthomill.tasks.projection.plan.projection_tables import (
    BLOCKS,
    CENSUS,
    CORNERS,
    FACING,
    FRAMES,
    TRIANGLES,
    VERTICES,
    depth_table,
    mesh_blocks,
)
from orthomill.tasks.projection.surface_source import HeightModelSurface, MeshSurface, SimulatedMesh, Unit
from orthomill.tasks.visibility.triangle_blocks import SIDE, block_count

_SCAN = "photographs/scan.ply"  # what the stage `simulation` writes
_MESH: dict[str, Table] = {"vertices": VERTICES, "triangles": TRIANGLES}


def mesh_job(view: ProjectView, surface: MeshSurface | SimulatedMesh | HeightModelSurface) -> Job:
    """The mesh of the surface, mended."""
    if isinstance(surface, HeightModelSurface):
        return _height_mesh(view, surface.every)
    path = view.run_file(_SCAN) if surface.kind == "simulated" else surface.path
    return Job(
        stage="projection",
        item="mesh",
        function=mend_mesh,
        reads={"mesh": MeshFile(path)},
        writes={**_MESH, "census": CENSUS},
        params={"unit": surface.unit, "shift": surface.shift, "y_up": surface.y_up, "systems": (surface.crs, view.project.crs)},
        scratch=512 * MIB,
        remedy="decimate the mesh",
    )


def _height_mesh(view: ProjectView, every: int) -> Job:
    """The surface model of the project as a mesh."""
    heights = CORRECTED if view.has_stage("dsm_check") else HEIGHT
    grid = view.table(SURFACE).grid
    return Job(
        stage="projection",
        item="mesh",
        function=mend_heights,
        reads={"heights": Raster(view.raster(heights).name, Window(0, 0, *grid.shape))},
        writes={**_MESH, "census": CENSUS},
        params={"grid": grid, "every": every},
        scratch=array_bytes(700, grid) // every**2,
        remedy="set a larger 'every' of the surface",
    )


def block_jobs(census: MeshCensus) -> Iterator[RasterSpec | Job]:
    """The mesh in blocks."""
    blocks = block_count(census.triangles)
    spec = RasterSpec(name=CORNERS, shape=(blocks * SIDE, SIDE, 9), dtype="float32", chunk=SIDE, unit="m")
    yield spec
    yield Job(
        stage="projection",
        item="blocks",
        function=cut_into_blocks,
        reads=_MESH,
        writes={"corners": Raster(CORNERS, spec.full), "boxes": BLOCKS},
        scratch=array_bytes(60, census.vertices) + array_bytes(150, census.triangles),
    )


def frames_job(outputs: tuple[Output, ...], names: tuple[str, ...], unit: Unit) -> Job:
    """Where the outputs lie, from the mesh and the photographs `names`; `unit` of the surface as it was given."""
    return Job(
        stage="projection",
        item="frames",
        function=output_frames,
        reads={**_MESH, "census": CENSUS, "block": BLOCK},
        writes={"frames": FRAMES},
        params={"outputs": outputs, "taking_part": names, "unit": unit},
        scratch=256 * MIB,
    )


def facing_job(names: tuple[str, ...], faces: Literal["auto", "outwards", "inwards"]) -> Job:
    """Which way the mesh faces, from what the photographs `names` show of it, unless `faces` says it."""
    return Job(
        stage="projection",
        item="facing",
        function=mesh_facing,
        reads={"seen": tuple(depth_table(name) for name in names)},
        writes={"facing": FACING},
        params={"names": names, "faces": faces},
    )


def line_jobs(lines: tuple[SectionLine, ...], blocks: int) -> Iterator[Job | Export]:
    """The section lines of a mesh of so many blocks, as DXF and GeoJSON."""
    for line in lines:
        tables = {kind: Table(f"projection/lines/{line.name}-{kind}.json", LineText) for kind in ("dxf", "geojson")}
        yield Job(
            stage="projection",
            item=f"line-{line.name}",
            function=draw_section,
            reads={"blocks": Stream(mesh_blocks(tuple(range(blocks)))), "census": CENSUS},
            writes=tables,
            params={"line": line},
            scratch=256 * MIB,
        )
        for kind, table in tables.items():
            yield Export("projection", f"{line.name}-{kind}", f"products/{line.name}.{kind}", "text", tables=(table,))
