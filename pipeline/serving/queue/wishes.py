"""What a task's options ask of its workflow, and the workflow that keeps it."""

from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict
from pyproj import CRS, Transformer

from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import WorkflowError

GEOGRAPHIC = "EPSG:4326"


class Wishes(BaseModel):
    """Options in the terms of a workflow.

    settings: values by their place: "crs", "tolerances.plan", or, with the stage first, "texture.cell"
    left_out: stages that are not run
    boundary: longitudes and latitudes (degrees) of an area; the surface is made within its extent
    processes: worker processes, 0 for as many as the server gives
    ortho_cell, dem_cell: cells (m) of the files that are delivered, 0 for those of the products
    rerun_from: stage that runs again with all after it
    notes: sentences for the task's output
    """

    model_config = ConfigDict(frozen=True)

    settings: dict[str, Any] = {}
    left_out: tuple[str, ...] = ()
    boundary: tuple[tuple[float, float], ...] = ()
    processes: int = 0
    ortho_cell: float = 0.0
    dem_cell: float = 0.0
    formats: tuple[str, ...] = ()
    """in which orthoimage and surface are delivered besides GeoTIFF, as `orthomill export --as` names them"""
    tiled_cloud: bool = True
    """whether the points are delivered as Entwine tiles too, which viewers of points read"""
    rerun_from: str = ""
    notes: tuple[str, ...] = ()


def wished_workflow(start: dict[str, Any], wishes: Wishes) -> dict[str, Any]:
    """The data of a workflow with what is wished for. Raises WorkflowError for a setting of a stage that it does not have, and for
    a boundary without a reference system to put it in."""
    stages = [{"kind": stage} if isinstance(stage, str) else dict(stage) for stage in start.get("stages", ())]
    stages = [stage for stage in stages if stage.get("kind") not in wishes.left_out]
    wished: dict[str, Any] = {**start, "stages": stages}
    kinds = {stage["kind"]: stage for stage in stages}
    for place, value in wishes.settings.items():
        first, *rest = place.split(".")
        if first == "positions" and _kind(start) == "none":
            continue
        if first in kinds and rest:
            _set(kinds[first], rest, value)
        elif first in wishes.left_out:
            continue
        else:
            _set(wished, [first, *rest], value)
    if wishes.boundary:
        _set(wished, ["grid", "kind"], "map")
        _set(wished, ["grid", "area"], list(_extent(wishes.boundary, wished.get("crs"))))
    return wished


def not_kept(start: dict[str, Any], wishes: Wishes) -> list[str]:
    """Sentences about what is wished for and cannot be."""
    placeless = _kind(start) == "none" and any(place.startswith("positions.") for place in wishes.settings)
    return ["Not used: the accuracy of positions, for no photograph has one."] if placeless else []


def _kind(start: dict[str, Any]) -> Any:
    """How a workflow knows the positions of its photographs."""
    positions = start.get("positions")
    return positions.get("kind") if isinstance(positions, dict) else None


def _set(values: dict[str, Any], path: list[str], value: Any) -> None:
    for name in path[:-1]:
        inner = values.get(name)
        values[name] = dict(inner) if isinstance(inner, dict) else {}
        values = values[name]
    values[path[-1]] = value


def _extent(boundary: tuple[tuple[float, float], ...], crs: Any) -> tuple[float, float, float, float]:
    """x and y (m) of the lower left and the upper right corner around a boundary."""
    if not isinstance(crs, str):
        raise WorkflowError("The boundary needs a reference system of the project: photographs with positions, or the option crs.")
    system = CRS.from_user_input(crs).to_2d()
    longitudes, latitudes = zip(*boundary, strict=True)
    xs, ys = Transformer.from_crs(GEOGRAPHIC, system, always_xy=True).transform(longitudes, latitudes)
    return min(xs), min(ys), max(xs), max(ys)


def write_wished_workflow(start: Path, target: Path, wishes: Wishes) -> list[str]:
    """From the workflow that `init` wrote to the one that is run; sentences about what cannot be as wished. Raises WorkflowError
    and StoreError."""
    try:
        found = yaml.safe_load(start.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise WorkflowError(f"The starting workflow {start.name} cannot be read: {error}.") from error
    text = yaml.safe_dump(wished_workflow(found, wishes), sort_keys=False, allow_unicode=True)
    write_whole(target, text.encode())
    return not_kept(found, wishes)
