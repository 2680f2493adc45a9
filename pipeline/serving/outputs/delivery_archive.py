"""What a finished task delivers: maps for clients, the archive, and lines that say what is in it."""

import json
from collections.abc import Callable, Iterator

from orthomill.pipeline.serving.outputs.asset_files import DSM, DTM, ORTHO, OWN, Asset, assets, wanted_only, write_archive
from orthomill.pipeline.serving.queue.task_folder import TaskFolder
from orthomill.pipeline.serving.queue.task_state import TaskState
from orthomill.pipeline.serving.queue.wishes import Wishes
from orthomill.schemas.errors import OrthomillError

_MAPS = (("ortho.tif", ORTHO, 4), ("dsm.tif", DSM, 1), ("terrain.tif", DTM, 1))
"""products, their places, and how many of their bands clients show"""
_PICTURES = {"png": "odm_orthophoto/odm_orthophoto.png", "mbtiles": "odm_orthophoto/odm_orthophoto.mbtiles"}
_EXACT = (
    ("dsm.tif", "heights with their standard errors"),
    ("dsm_check.tif", "where the surface was checked, and by how much it was wrong"),
    ("dsm_provenance.tif", "codes: measured, estimated, and from what"),
    ("accuracy.json", "the statement of accuracy"),
    ("summary.json", "every figure of the report by its name"),
)

Command = Callable[[list[str]], None]
"""Runs a command of the engine in the task's folder"""


def write_delivery(folder: TaskFolder, state: TaskState, wishes: Wishes, command: Command, verdict: str) -> list[str]:
    """Write all.zip; lines that name what is in it. Raises StoreError where there is no room for it."""
    lines: list[str] = []
    made = list(_maps(folder, wishes, lines)) + list(_pictures(folder, wishes, command, lines))
    chosen = list(wanted_only(assets(folder.run, made), state.outputs))
    log = {
        "engine": "orthomill",
        "name": state.name,
        "options": [option.model_dump() for option in state.options],
        "verdict": verdict,
    }
    texts = {"task_output.txt": "\n".join(folder.lines()) + "\n", "log.json": json.dumps(log, indent=1)}
    places = write_archive(folder.results, chosen, texts)
    lines += [
        f"{OWN}/{place}: {what}."
        for name, what in _EXACT
        for place in [next((p.removeprefix(f"{OWN}/") for p in places if p in (f"{OWN}/{name}", f"{OWN}/products/{name}")), "")]
        if place
    ]
    lines.append(f"all.zip holds {len(places)} files, {folder.results.stat().st_size / 1e6:.1f} MB.")
    return lines


def _maps(folder: TaskFolder, wishes: Wishes, lines: list[str]) -> Iterator[Asset]:
    from orthomill.pipeline.serving.outputs.client_maps import write_client_map

    for name, place, bands in _MAPS:
        product = folder.run / "products" / name
        if not product.is_file():
            continue
        cell = wishes.ortho_cell if place == ORTHO else wishes.dem_cell
        target = folder.path / "made" / place
        if said := write_client_map(product, target, bands, cell):
            lines.append(said)
        yield Asset(target, place)


def _pictures(folder: TaskFolder, wishes: Wishes, command: Command, lines: list[str]) -> Iterator[Asset]:
    """The orthoimage in other formats, by `orthomill export`; what cannot be made is told and fails nothing."""
    for kind in wishes.pictures:
        path = folder.run / "products" / "exported" / f"client.{kind}"
        try:
            command(["export", folder.run.name, path.relative_to(folder.run).as_posix(), "--as", kind, "--of", "ortho"])
        except OrthomillError as error:
            lines.append(f"Not made: {_PICTURES[kind]}: {error}")
            continue
        yield Asset(path, _PICTURES[kind])
