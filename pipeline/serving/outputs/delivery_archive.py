"""What a finished task delivers: maps for clients, the archive, and lines that say what is in it."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.report.paper import can_print, write_pdf
from orthomill.pipeline.serving.outputs.asset_files import CLOUD, DSM, DTM, ORTHO, OWN, Asset, assets, wanted_only, write_archive
from orthomill.pipeline.serving.outputs.client_figures import client_figures
from orthomill.pipeline.serving.queue.object_places import send_results
from orthomill.pipeline.serving.queue.task_folder import TaskFolder
from orthomill.pipeline.serving.queue.task_state import TaskState
from orthomill.pipeline.serving.queue.wishes import Wishes
from orthomill.pipeline.storage.depots.product_files import product_file
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import OrthomillError

_MAPS = (("ortho", ORTHO, 4), ("dsm", DSM, 1), ("terrain", DTM, 1))
"""products, their places, and how many of their bands clients show"""
_EXACT = {
    "dsm.tif": "heights with their standard errors",
    "dsm_check.tif": "where the surface was checked, and by how much it was wrong",
    "dsm_provenance.tif": "codes: measured, estimated, and from what",
    "accuracy.json": "the statement of accuracy",
    "summary.json": "every figure of the report by its name",
}

Command = Callable[[list[str]], None]
"""Runs a command of the engine in the task's folder"""


@dataclass(frozen=True)
class _Made:
    """A file or folder that `orthomill export` makes: format, product ("": the run), and place in all.zip."""

    kind: str
    of: str
    place: str


_WISHED = {
    "png": _Made("png", "ortho", "odm_orthophoto/odm_orthophoto.png"),
    "xyz": _Made("xyz", "ortho", "orthophoto_tiles"),
    "glb": _Made("glb", "dsm", "odm_texturing/odm_textured_model_geo.glb"),
    "3dtiles": _Made("3dtiles", "dsm", "3d_tiles/model"),
}
_EPT = _Made("ept", "points", "entwine_pointcloud")
_ONE_CLOUD = _Made("laz", "points", CLOUD)
_BLOCK = _Made("odm", "", f"{OWN}/odm")
_SHOTS, _CONTROL = "odm_report/shots.geojson", "odm_georeferencing/ground_control_points.geojson"
_OF_BLOCK = {
    f"{OWN}/odm/shots.geojson": _SHOTS,
    f"{OWN}/odm/cameras.json": "cameras.json",
    f"{OWN}/odm/ground_control_points.geojson": _CONTROL,
}
"""places that clients know of files of the block"""
_FIGURES = "odm_report/stats.json"


def write_delivery(
    folder: TaskFolder, state: TaskState, wishes: Wishes, command: Command, verdict: str, paper: bool = False
) -> list[str]:
    """Write all.zip; lines that name what is in it. With `paper` the report is printed as well, where this machine can print.
    Raises StoreError where there is no room, ResourceError for an object store that refuses."""
    lines: list[str] = []
    if paper:
        lines += _printed(folder.run / "report.html")
    made = list(_maps(folder, wishes, lines))
    for wanted in _exports(folder, wishes):
        made += _exported(folder, wanted, command, lines)
    made += _figures(folder, made)
    chosen = list(wanted_only(assets(folder.run, made), state.outputs))
    given = [option.model_dump() for option in state.options]
    log = {"engine": "orthomill", "name": state.name, "options": given, "verdict": verdict}
    texts = {"task_output.txt": "\n".join(folder.lines()) + "\n", "log.json": json.dumps(log, indent=1)}
    places = write_archive(folder.results, chosen, texts)
    if state.write_to:
        count = send_results(state.write_to, chosen)
        lines.append(f"{count} files were written to {state.write_to}.")
    own = {Path(place).name: place for place in places if place.startswith(f"{OWN}/")}
    lines += [f"{own[name]}: {what}." for name, what in _EXACT.items() if name in own]
    lines.append(f"all.zip holds {len(places)} files, {folder.results.stat().st_size / 1e6:.1f} MB.")
    return lines


def _printed(report: Path) -> list[str]:
    """The report as a PDF beside it, which WebODM has a button for; a sentence where it was not printed."""
    if report.is_file() and can_print():
        try:
            write_pdf(report)
        except OrthomillError as error:
            return [f"Not made: odm_report/report.pdf: {error}"]
    return []


def _maps(folder: TaskFolder, wishes: Wishes, lines: list[str]) -> Iterator[Asset]:
    from orthomill.pipeline.serving.outputs.client_maps import write_client_map

    cutline = _cutline(folder, wishes)
    for name, place, bands in _MAPS:
        if (product := product_file(folder.run, name)) is None:
            continue
        cell = wishes.ortho_cell if place == ORTHO else wishes.dem_cell
        target = folder.path / "made" / place
        if said := write_client_map(product, target, bands, cell, cutline):
            lines.append(said)
        yield Asset(target, place)


def _figures(folder: TaskFolder, made: list[Asset]) -> list[Asset]:
    """The figures of the run as a client shows them."""
    summary = folder.run / "summary.json"
    if not summary.is_file():
        return []
    paths = {asset.place: asset.path for asset in assets(folder.run, made)}
    target = folder.path / "made" / _FIGURES
    target.parent.mkdir(parents=True, exist_ok=True)
    figures = client_figures(summary, paths.get(_SHOTS), paths.get(_CONTROL), paths.get(CLOUD))
    write_whole(target, json.dumps(figures, indent=1).encode())
    return [Asset(target, _FIGURES)]


def _cutline(folder: TaskFolder, wishes: Wishes) -> Path | None:
    """The boundary as a file, which maps are cut along."""
    if not wishes.boundary:
        return None
    ring = [*wishes.boundary, *wishes.boundary[:1]] if wishes.boundary[0] != wishes.boundary[-1] else wishes.boundary
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    path = folder.path / "boundary.geojson"
    write_whole(path, json.dumps({"type": "FeatureCollection", "features": [feature]}).encode())
    return path


def _exports(folder: TaskFolder, wishes: Wishes) -> Iterator[_Made]:
    products = folder.run / "products"
    if product_file(folder.run, "ortho"):
        yield from (_WISHED[kind] for kind in wishes.formats)
    if (products / "cameras.json").is_file():
        yield _BLOCK
    # The points of a large surface are a folder of files; clients know one.
    if (products / "points").is_dir():
        yield _ONE_CLOUD
    if wishes.tiled_cloud and ((products / "points").is_dir() or (products / "points.laz").is_file()):
        yield _EPT


def _exported(folder: TaskFolder, wanted: _Made, command: Command, lines: list[str]) -> list[Asset]:
    """A file, or the files of a folder; what cannot be made is told and fails nothing."""
    path = folder.run / "products" / "exported" / f"client_{wanted.kind}{Path(wanted.place).suffix}"
    try:
        of = ["--of", wanted.of] if wanted.of else []
        command(["export", folder.run.name, path.relative_to(folder.run).as_posix(), "--as", wanted.kind, *of])
    except OrthomillError as error:
        lines.append(f"Not made: {wanted.place}: {error}")
        return []
    if not path.exists():
        return []
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        places = [f"{wanted.place}/{file.relative_to(path).as_posix()}" for file in files]
        return [Asset(file, _OF_BLOCK.get(place, place)) for file, place in zip(files, places, strict=True)]
    return [Asset(path, wanted.place)]
