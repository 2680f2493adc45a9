"""Where the products of a run lie in all.zip: the places that WebODM knows, and `orthomill/` for what only orthomill makes.

Files are stored and not compressed: maps, point clouds and pictures are compressed already, and parts can be read by range.
"""

import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orthomill.pipeline.storage.whole_files import whole_file

ORTHO, DSM, DTM = "odm_orthophoto/odm_orthophoto.tif", "odm_dem/dsm.tif", "odm_dem/dtm.tif"
CLOUD = "odm_georeferencing/odm_georeferenced_model.laz"
ROOMS = frozenset(
    {"odm_orthophoto", "odm_dem", "odm_georeferencing", "odm_texturing", "odm_report", "entwine_pointcloud", "3d_tiles"}
    | {"orthophoto_tiles", "orthomill"}
)
"""folders of all.zip"""
PLACES = {"points.laz": CLOUD, "report.html": "odm_report/report.html", "report.pdf": "odm_report/report.pdf"}
"""places in all.zip of products that go there as they are"""
OWN = "orthomill"
"""folder of all.zip with everything else, under the names that it has after a run of one's own"""
SHORT = {
    "orthophoto.tif": ORTHO,
    "dsm.tif": DSM,
    "dtm.tif": DTM,
    "georeferenced_model.laz": CLOUD,
    "report.html": PLACES["report.html"],
}
"""single files that can be downloaded by the names of the contract"""
PRIMARY = {"all_zip": "all.zip", "orthophoto": ORTHO, "dsm": DSM, "dtm": DTM, "point_cloud": CLOUD}
"""what everybody asks for, by the names of ScaleODM"""
_RUN_FILES = ("summary.json", "workflow.yaml", "report.html", "report.pdf", "signature.json", "tiles.html")
_MEANINGS = """These files are orthomill's; every estimate comes with its precision.

dsm.tif              heights (band 1), their standard errors and what they are made of (further bands are described in the file)
dsm_provenance.tif   for each height: measured, estimated, and from what, as codes
dsm_check.tif        shifts and corrections of the check of the surface by the photographs
ortho_height_source.tif  on what kind of height each pixel of the orthoimage lies
report.html          first page with the verdict, and everything behind it
summary.json         every figure of the report by name
workflow.yaml        the workflow as run, every default filled in
"""


@dataclass(frozen=True)
class Asset:
    """A file, and its place in all.zip."""

    path: Path
    place: str


def assets(run: Path, made: Iterable[Asset] = ()) -> Iterator[Asset]:
    """Every file of a run that is delivered, once. `made`: files made for the client, which come first."""
    taken = set()
    for asset in made:
        taken.add(asset.place)
        yield asset
    for path in _delivered(run):
        within = path.relative_to(run / "products") if path.is_relative_to(run / "products") else path.relative_to(run)
        place = PLACES.get(within.as_posix(), f"{OWN}/{within.as_posix()}")
        if place not in taken:
            taken.add(place)
            yield Asset(path, place)


def _delivered(run: Path) -> Iterator[Path]:
    """Products without what was made of them for clients, and the pages of the run."""
    made = run / "products" / "exported"
    for path in sorted((run / "products").rglob("*")):
        if path.is_file() and not path.is_symlink() and not path.is_relative_to(made):
            yield path
    yield from (run / name for name in _RUN_FILES if (run / name).is_file())


def write_archive(target: Path, chosen: Iterable[Asset], texts: dict[str, str]) -> list[str]:
    """Write all.zip with files and `texts` by place; the places. Raises StoreError where the disk is full."""
    places = []
    with whole_file(target) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        for asset in chosen:
            archive.write(asset.path, asset.place)
            places.append(asset.place)
        for place, text in {f"{OWN}/README.txt": _MEANINGS, **texts}.items():
            archive.writestr(place, text)
            places.append(place)
    return places


def wanted_only(chosen: Iterable[Asset], outputs: tuple[str, ...]) -> Iterator[Asset]:
    """The files at or below the places that a client asked for; all where it asked for none."""
    wanted = [place.strip("/") for place in outputs]
    for asset in chosen:
        if not wanted or any(asset.place == place or asset.place.startswith(f"{place}/") for place in wanted):
            yield asset


def asset_path(task: Path, name: str) -> Path | None:
    """The file of a task that a client downloads: all.zip, a single file by its short name, or any by its place in all.zip."""
    if name == "all.zip":
        return path if (path := task / "all.zip").is_file() else None
    place = SHORT.get(name, name)
    return next((asset.path for asset in task_assets(task) if asset.place == place), None)


def task_assets(task: Path) -> Iterator[Asset]:
    """Every file that a task delivers, by its place in all.zip."""
    made = [
        Asset(path, path.relative_to(task / "made").as_posix()) for path in sorted((task / "made").rglob("*")) if path.is_file()
    ]
    runs = [path for path in (task / "runs").iterdir() if path.is_dir()] if (task / "runs").is_dir() else []
    for run in runs:
        yield from assets(run, made)


def listed_assets(uuid: str, places: list[str], most: int) -> dict[str, list[dict[str, Any]]]:
    """The files of a task as ScaleODM lists them: those that everybody asks for, there or not, and at most so many others."""

    def at(place: str) -> dict[str, str]:
        return {"asset": place, "downloadUrl": f"/task/{uuid}/download/{place}"}

    known = set(places)
    primary = [
        {"id": kind, "asset": place, "exists": place in known} | (at(place) if place in known else {})
        for kind, place in PRIMARY.items()
    ]
    others = [at(place) for place in places if place not in PRIMARY.values()]
    return {"primary": primary} | ({"additional": others[:most]} if most else {})
