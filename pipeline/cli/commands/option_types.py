"""Arguments and options that several commands share, or that are long to describe."""

from pathlib import Path
from typing import Annotated

import typer

From = Annotated[str | None, typer.Option("--from", help="Run this stage and all later ones again, changed or not.")]
Until = Annotated[str | None, typer.Option(help="Stop after this stage.")]
Sequential = Annotated[bool, typer.Option("--sequential", help="One job after another in this process, without Dask.")]
Workers = Annotated[int, typer.Option(help="Worker processes; 0 is one per core.", min=0)]
Memory = Annotated[int, typer.Option(help="Memory that one worker may use, in MiB.", min=256)]
RasterName = Annotated[
    str | None, typer.Argument(help="A raster of the store, e.g. densification/precision; all products when left out.")
]
CheckedFile = Annotated[Path, typer.Argument(metavar="SURFACE", help="A GeoTIFF, LAS or LAZ file of any program.")]
PhotosOf = Annotated[Path | None, typer.Option("--photos", help="Folder with photographs of the same ground.")]
BlockOf = Annotated[
    Path | None,
    typer.Option(
        "--block", help="Their orientation: cameras.json, OpenSfM's reconstruction.json, a CSV of angles, COLMAP's folder of texts."
    ),
]
ProjectOf = Annotated[str | None, typer.Option("--project", help="A finished project: its photographs and their orientation.")]
CrsOf = Annotated[str | None, typer.Option("--crs", help="Projected CRS of the answer; by default that of block or surface.")]
SystemOf = Annotated[str | None, typer.Option("--system", help="Reference system of a surface whose file names none.")]
RemoveShift = Annotated[bool, typer.Option("--remove-shift", help="Take a shift of the whole surface out.")]
Fill = Annotated[bool, typer.Option("--fill", help="Fill holes of the surface by matching of the photographs.")]
Ortho = Annotated[bool, typer.Option("--ortho", help="Make the orthoimage of the corrected surface as well.")]
CheckedArea = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option("--area", help="Check only there: west, south, east and north, m, in the CRS of the answer."),
]
CheckedPolygons = Annotated[
    Path | None, typer.Option("--cutline", help="Check only inside of polygons (.gpkg, .geojson), in any system.")
]
