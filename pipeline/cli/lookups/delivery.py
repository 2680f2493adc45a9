"""`orthomill accept`: the facts of a delivery, of a finished run or of files from another program, and its clauses."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from orthomill.pipeline.cli.lookups.titled_systems import names_of_file, system_names
from orthomill.pipeline.cli.point_lists import point_list
from orthomill.pipeline.engine.run_facts import read_facts
from orthomill.pipeline.engine.running import titles_of
from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.report.results import rewrite_page
from orthomill.pipeline.storage.delivered_ortho import covered_share, gaps_of, orthoimage_facts
from orthomill.pipeline.storage.depots.folder import PRODUCTS
from orthomill.pipeline.storage.depots.kept_products import KeptProducts
from orthomill.pipeline.storage.depots.product_files import as_they_lie
from orthomill.pipeline.storage.height_files import check_height_file, plan_crs_of, read_height_grid, read_heights
from orthomill.pipeline.storage.height_systems import FEET
from orthomill.pipeline.storage.map_files import opened_map, read_map, read_map_grid
from orthomill.pipeline.storage.point_files import is_point_file
from orthomill.pipeline.storage.store import Store
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.pipeline.workflow.yaml_lines import YamlError, read_yaml
from orthomill.schemas.accuracy.acceptance import (
    Acceptance,
    AcceptanceLimits,
    AcceptanceResult,
    DeliveryFacts,
    InspectedProducts,
    NoAcceptance,
)
from orthomill.schemas.accuracy.acceptance_record import SystemNames
from orthomill.schemas.accuracy.accuracy_statement import STATEMENT, AccuracyStatement
from orthomill.schemas.accuracy.point_tests import POINT_TESTS
from orthomill.schemas.errors import StoreError, WorkflowError
from orthomill.schemas.job import HeightFile, HeightHeader, MapFile
from orthomill.schemas.observations import CONTROL
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.project import Project
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.stage_report import StageReport, Topic, report_table
from orthomill.schemas.surface import MEASURED, PROVENANCE

Inspect = Callable[..., InspectedProducts]


@dataclass(frozen=True)
class Delivered:
    """Files of a delivery of another program."""

    dsm: Path | None
    ortho: Path | None
    points: Path | None


def _shown(delivered: Delivered, area: Path | None) -> dict[str, Any]:
    """What products show of themselves, as fields of the facts. Raises WorkflowError."""
    dsm, ortho = delivered.dsm, delivered.ortho
    picture = orthoimage_facts(ortho) if ortho else None
    surface = None if dsm is None or is_point_file(dsm) else dsm
    products = (("orthoimage", ortho), ("surface", surface))
    return {
        "pixel": picture.pixel if picture else None,
        "voids": picture.voids if picture else None,
        "clipped": picture.clipped if picture else None,
        "gaps": gaps_of(surface) if surface else None,
        "covered": tuple((what, covered_share(path, area)) for what, path in products if path and area),
    }


Limits = dict[str, float]
"""limits that the command line names, by the name of their setting"""


def profile_of(name: str | None, project: Project | None, limits: Limits | None = None) -> AcceptanceLimits:
    """A profile by name, a YAML file with one, or the one of the project; `limits` replace those that it has. Raises
    WorkflowError."""
    agreed = project.acceptance if project else NoAcceptance(kind="none")
    if name is None:
        if isinstance(agreed, NoAcceptance):
            raise WorkflowError(
                "No profile: write acceptance: {kind: asprs_2023, plan: 0.05, height: 0.05} into the workflow, or give --profile."
            )
        return _profile("the project's profile", agreed.model_dump() | (limits or {}))
    try:
        given: Any = read_yaml(Path(name).read_text(encoding="utf-8")).value if Path(name).is_file() else {"kind": name}
    except YamlError as error:
        raise WorkflowError(f"{name}, line {error.line}: {error.sentence}") from error
    # The project's own numbers, where it has this profile.
    if isinstance(given, dict) and given.get("kind") == agreed.kind:
        given = agreed.model_dump()
    return _profile(f"--profile {name}", given | (limits or {}) if isinstance(given, dict) else given)


def profile_from(kind: str, limits: dict[str, Any]) -> AcceptanceLimits:
    """The profile of an acceptance that was kept. Raises WorkflowError."""
    return _profile("the profile that was kept", {"kind": kind, **limits})


def _profile(what: str, given: object) -> AcceptanceLimits:
    try:
        chosen = TypeAdapter[Acceptance](Acceptance).validate_python(given)
    except ValidationError as error:
        told = "; ".join(
            f"{'.'.join(map(str, e['loc'])) or 'kind'}: {e['msg'].removeprefix('Value error, ')}" for e in error.errors()
        )
        raise WorkflowError(
            f"{what}: {told}. Profiles are asprs_2023, adv_truedop, inspire_oi, custom, or a YAML file of one; --plan and --height "
            "name limits as well."
        ) from error
    if isinstance(chosen, NoAcceptance):
        raise WorkflowError("The profile 'none' asks for nothing; choose asprs_2023, adv_truedop, inspire_oi or custom.")
    return chosen


def facts_of_run(folder: Path, crs: str, area: Path | None = None) -> DeliveryFacts:
    """What a finished run delivers; area: the polygons that were ordered."""
    store, products = Store(folder), KeptProducts(folder)
    dsm, ortho = (products.raster(name) for name in ("dsm", "ortho"))
    delivered = Delivered(dsm, ortho, None)
    first, last = _days(store)
    run = read_facts(folder)
    stages = [stage.kind for stage in run.stages] if run else []
    return DeliveryFacts(
        statement=store.table(STATEMENT) if store.has_table(STATEMENT) else AccuracyStatement(),
        points=store.table(POINT_TESTS).points if store.has_table(POINT_TESTS) else (),
        made=f"by orthomill {run.version}, finished {_minute(run.finished)}" if run and run.finished else "",
        known=tuple(_known(store, stages)),
        doubts=tuple(doubt for report in _reports(store, stages) for doubt in report.doubts),
        systems=system_names(crs),
        **_shown(delivered, area),
        estimated=_estimated(store),
        seams=_seams(folder),
        first_day=first,
        last_day=last,
        crs=crs,
    )


_LEVELS = {Topic.CHECK: "Agreement", Topic.PRECISION: "Promise"}
"""what a run knows of itself without a surveyed point"""


def _known(store: Store, stages: list[str]) -> Iterator[str]:
    told = {answer.topic: answer.text for report in _reports(store, stages) for answer in report.answers}
    yield from (f"{level}: {topic.lower()}, {told[topic]}" for topic, level in _LEVELS.items() if topic in told)


def _reports(store: Store, stages: list[str]) -> Iterator[StageReport]:
    made = store.file_names(PRODUCTS)
    yield from (as_they_lie(store.table(table), made) for stage in stages if store.has_table(table := report_table(stage)))


def _minute(time: str) -> str:
    """2026-05-31 12:30 of an ISO 8601 time."""
    return time[:16].replace("T", " ")


def _days(store: Store) -> tuple[str, str] | tuple[None, None]:
    """The first and the last day of the photographs, where they say when they were taken."""
    times = sorted(photo.time for photo in store.table(PHOTOS).photos if photo.time) if store.has_table(PHOTOS) else []
    return (times[0][:10], times[-1][:10]) if times else (None, None)


def show_acceptance(loaded: LoadedWorkflow) -> None:
    """Write the report of a run again, which shows what was kept of its acceptance. Raises ResourceError during a run."""
    folder = loaded.run_folder
    facts = read_facts(folder)
    if facts is not None:
        with only_run(folder):
            rewrite_page(Store(folder), folder, titles_of(loaded.stages), facts)


def _estimated(store: Store) -> float | None:
    if not store.has(PROVENANCE):
        return None
    spec, known, guessed = store.spec(PROVENANCE), 0, 0
    for row in range(0, spec.shape[0], spec.chunk):
        window = Window(row, 0, spec.chunk, spec.shape[1]).clipped(spec.shape)
        codes = store.read(PROVENANCE, window)
        known += int((codes > 0).sum())
        guessed += int(((codes > 0) & ~np.isin(codes, MEASURED)).sum())
    return 100.0 * guessed / known if known else None


def _seams(folder: Path) -> float | None:
    path = folder / "summary.json"
    value = json.loads(path.read_text()).get("texture.seam_difference", {}).get("value") if path.exists() else None
    return float(value) if value is not None else None


def facts_of_files(
    delivered: Delivered, own: str | None, inspect: Inspect, listed: Callable[..., Any], area: Path | None = None
) -> DeliveryFacts:
    """What files of another program deliver; own: the system of the points, None for that of their list or of the products; area:
    the polygons that were ordered. Raises WorkflowError for what cannot be read."""
    for path, option in ((delivered.dsm, "--dsm"), (delivered.ortho, "--ortho"), (delivered.points, "--points")):
        if path is not None and not path.is_file():
            raise WorkflowError(f"There is no file {path} ({option}); correct the path.")
    grid, heights, crs = _surface(delivered.dsm)
    if crs and delivered.ortho and (of_picture := plan_crs_of(delivered.ortho)) != crs:
        raise WorkflowError(
            f"{delivered.dsm} is in {crs} and {delivered.ortho} in {of_picture or 'no projected system in metres'}: warp one into "
            "the system of the other (gdalwarp -t_srs)."
        )
    system = crs or (delivered.ortho and plan_crs_of(delivered.ortho)) or ""
    image = read_map_grid(delivered.ortho, system) if delivered.ortho and system else None
    found = listed(*point_list(delivered.points, own), system) if delivered.points else None
    tested = inspect(found.points, grid, heights, image) if found else InspectedProducts()
    if found and grid:
        _refuse_elsewhere(found.points, grid, crs, delivered)
    return DeliveryFacts(
        remarks=found.remarks if found else (),
        statement=tested.statement,
        points=tested.points,
        systems=_systems(delivered),
        **_shown(delivered, area),
        crs=system,
    )


def _systems(delivered: Delivered) -> SystemNames | None:
    """Those of the surface, as it names them; of the orthoimage alone where there is no surface."""
    path = delivered.dsm or delivered.ortho
    return names_of_file(path) if path else None


def _refuse_elsewhere(points: tuple[Any, ...], grid: MapGrid, crs: str, delivered: Delivered) -> None:
    x, y = np.array([point.xyz[:2] for point in points]).T
    if _any_on(grid, x, y):
        return
    if _any_on(grid, FEET["ft"] * x, FEET["ft"] * y):
        raise WorkflowError(
            f"The points of {delivered.points} lie on {delivered.dsm} only if their coordinates are feet: convert the list to "
            "metres, or name its system, in feet, with --crs."
        )
    east, south = grid.west + grid.cols * grid.cell, grid.north - grid.rows * grid.cell
    raise WorkflowError(
        f"None of the {len(points)} points of {delivered.points} lies on {delivered.dsm}: they are about {np.median(x):.0f}, "
        f"{np.median(y):.0f}, and it reaches from {grid.west:.0f}, {south:.0f} to {east:.0f}, {grid.north:.0f} in {crs}. Name the "
        "system of the points with --crs, or correct their list."
    )


def _any_on(grid: MapGrid, x: np.ndarray, y: np.ndarray) -> bool:
    col, row = grid.pixel(x, y)
    return bool(((col > -1) & (col < grid.cols) & (row > -1) & (row < grid.rows)).any())


def facts_by_inspector(
    folder: Path,
    delivered: Delivered,
    crs: str,
    inspector: Callable[..., Any],
    roles: tuple[str, ...] = ("check",),
    area: Path | None = None,
) -> DeliveryFacts:
    """Files of another program at the check points of a run (those of these roles), whose photographs show where an orthoimage has
    them. Raises StoreError before the run has a block, WorkflowError for files that cannot be read."""
    store = Store(folder)
    if not (store.has_table(BLOCK) and store.has_table(CONTROL)):
        raise StoreError(f"{folder.name} has no block yet; run it first: orthomill run {folder.name} --until orientation")
    known = inspector(
        store.table(BLOCK),
        store.table(PHOTOS),
        store.table(CONTROL),
        lambda photo, level, window: store.read(photo_raster(photo, level), window),
        roles,
    )
    surface, image = _heights_in(delivered.dsm, crs), _colours_in(delivered.ortho, crs)
    first, last = _days(store)
    tested = known.products(surface, image)
    return DeliveryFacts(
        statement=tested.statement,
        points=tested.points,
        systems=_systems(delivered),
        **_shown(delivered, area),
        first_day=first,
        last_day=last,
        crs=crs,
    )


Part = tuple[MapGrid, Callable[[MapGrid, Window], np.ndarray]]


def _heights_in(path: Path | None, crs: str) -> Part | None:
    """A surface in the system of a project."""
    if path is None:
        return None
    check_height_file(path)
    return read_height_grid(path, HeightHeader(str(path), crs)), lambda grid, window: read_heights(
        path, HeightFile(str(path), crs, grid, window)
    )


def _colours_in(path: Path | None, crs: str) -> Part | None:
    """An orthoimage in the system of a project; where it has no colour, NaN."""
    if path is None:
        return None
    return read_map_grid(path, crs), lambda grid, window: read_map(path, MapFile(str(path), crs, grid, window, bands=3))


def _surface(path: Path | None) -> tuple[MapGrid | None, Callable[[MapGrid, Window], np.ndarray] | None, str]:
    if path is None:
        return None, None, ""
    check_height_file(path)
    _refuse_colours(path)
    crs = plan_crs_of(path)
    if crs is None:
        raise WorkflowError(f"{path} is in no projected system in metres; warp it into one (gdalwarp -t_srs).")
    grid = read_height_grid(path, HeightHeader(str(path), crs))
    return grid, lambda cells, window: read_heights(path, HeightFile(str(path), crs, cells, window)), crs


def _refuse_colours(path: Path) -> None:
    if not is_point_file(path):
        with opened_map(path, "EPSG:4326") as source:
            if source.dtypes[0] == "uint8" and source.count >= 3:
                raise WorkflowError(f"{path} has {source.count} bands of colours and no heights; is it the orthoimage (--ortho)?")


def acceptance_lines(result: AcceptanceResult) -> Iterator[str]:
    """One line for each clause, the verdict last."""
    for clause in result.clauses:
        yield f"{clause.outcome:13} {clause.clause}: {clause.found} (limit: {clause.limit})"
    yield from (f"found: {sentence}" for sentence in result.findings)
    yield from (f"doubt of the run: {sentence}" for sentence in (result.record.doubts if result.record else ()))
    yield result.sentence
