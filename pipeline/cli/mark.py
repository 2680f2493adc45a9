"""The marking page of a project: what its run has left so far, the marks that are kept, and the server that shows both."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from orthomill.pipeline.cli.point_lists import point_list
from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.serving.marking.field_files import next_sentence
from orthomill.pipeline.serving.marking.mark_ledger import MarkLedger
from orthomill.pipeline.serving.marking.marking_session import KnowsTheBlock, MarkingSession
from orthomill.pipeline.serving.marking.mask_images import MASKS, MaskImages, MaskOf
from orthomill.pipeline.serving.marking.photograph_crops import PhotographCrops
from orthomill.pipeline.storage.store import Store
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.errors import ResourceError, StoreError
from orthomill.schemas.job import Table
from orthomill.schemas.marks import FoundTarget, Marks
from orthomill.schemas.observations import CONTROL, GROUND_POINTS, IMAGE_RESIDUALS, TIE_POINTS, Control
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, Photos

MOST_FORESEEN = 120
"""photographs: the covariance of larger blocks takes longer than a plan should"""
GivenPoints = Callable[[Photos, str, str | None, str], Marks]
_TABLES: dict[str, Table[Any]] = {"block": BLOCK, "tie_points": TIE_POINTS, "residuals": IMAGE_RESIDUALS, "ground": GROUND_POINTS}


@dataclass(frozen=True)
class Marking:
    """What the catalogue knows of marking: a marker by the tables of a run (keywords), points of a text, control as marks, and
    hidden areas as a mask."""

    marker: Callable[..., KnowsTheBlock]
    given_points: GivenPoints
    marks_of: Callable[[Control], Marks]
    mask_of: MaskOf


def marks_folder(loaded: LoadedWorkflow) -> Path:
    """Where the marks of a project are kept: with its sources, for no run can make them again."""
    return loaded.root / "marks" / loaded.project.project


@contextmanager
def marking_session(loaded: LoadedWorkflow, marking: Marking, points: Path | None, crs: str | None) -> Iterator[MarkingSession]:
    """The marks of a project with the block that judges them, held against other processes until the context ends. Raises
    StoreError before the photographs are prepared, ResourceError where another process has them."""
    store = Store(loaded.run_folder)
    name = loaded.project.project
    if not (store.has_table(PHOTOS) and store.has_table(CAMERAS)):
        raise StoreError(f"{name} has no photographs prepared yet; run it first: orthomill run {name} --until calibration")
    photos = store.table(PHOTOS)
    tables: dict[str, Any] = {key: store.table(table) for key, table in _TABLES.items() if store.has_table(table)}
    with _held(marks_folder(loaded), name):
        sizes = {photo.name: (photo.width, photo.height) for photo in photos.photos}
        ledger = MarkLedger(marks_folder(loaded), loaded.project.crs, sizes)
        if ledger.is_new and store.has_table(CONTROL) and (control := store.table(CONTROL)).points:
            ledger.replace(marking.marks_of(control))
        if points is not None:
            ledger.replace(with_points(ledger.marks, marking.given_points(photos, *point_list(points, crs), loaded.project.crs)))
        known = marking.marker(photos=photos, cameras=store.table(CAMERAS), heights=_heights(ledger.marks), **tables)
        masks = MaskImages(loaded.root, marks_folder(loaded) / MASKS, photos.photos, marking.mask_of)
        yield MarkingSession(name, ledger, PhotographCrops(store, photos), known, masks)


def foreseen_points(loaded: LoadedWorkflow, marking: Marking) -> Iterator[str]:
    """Where another point would help a block most that is oriented, with the control that it has; nothing is written."""
    store = Store(loaded.run_folder)
    tables: dict[str, Any] = {key: store.table(table) for key, table in _TABLES.items() if store.has_table(table)}
    if not (store.has_table(PHOTOS) and store.has_table(CAMERAS) and "block" in tables):
        return
    photos = store.table(PHOTOS)
    if len(photos.photos) > MOST_FORESEEN:
        yield f"Where another control point would help most: orthomill mark {loaded.project.project} --where"
        return
    known = marking.marker(photos=photos, cameras=store.table(CAMERAS), heights=None, **tables)
    control = marking.marks_of(store.table(CONTROL)) if store.has_table(CONTROL) else Marks()
    found = known.next_points(control)
    yield from (next_sentence(one) for one in found)
    if found:
        yield f"As GPX and GeoJSON for the field: orthomill mark {loaded.project.project} --where"


def marked_automatically(
    session: MarkingSession, targets_in: Callable[[np.ndarray], tuple[FoundTarget, ...]], told: Callable[[str], None]
) -> Iterator[str]:
    """Mark what needs nobody; says of each point in how many photographs, what is wrong, and where the files are. `told` is called
    with what is done next."""
    numbers = {photo: number for number, photo in enumerate(session.crops.photos, 1)}

    @cache
    def targets_of(photo: str) -> tuple[FoundTarget, ...]:
        told(f"targets in {photo} ({numbers[photo]} of {len(numbers)})")
        return targets_in(session.crops.pixels(photo))

    before = {(point.name, photo) for point in session.ledger.marks.points for photo in point.marks}
    marks = session.mark_automatically(targets_of, told)
    for point in marks.points:
        new = [mark for photo, mark in point.marks.items() if (point.name, photo) not in before]
        by = {kind: sum(mark.by == kind for mark in new) for kind in ("target", "matched")}
        how = ", ".join(f"{count} {kind}" for kind, count in by.items() if count) or "nothing new"
        if not point.marks and not session.sights(point.name):
            how = "no photograph should show it"
        yield f"{point.name} ({point.role}): {len(point.marks)} marks ({how})"
    state = session.state()
    for one in state["judgement"].get("wrong", ()):
        yield f"wrong: {one['sentence']}"
    for distance, why in zip(marks.distances, state["left_out"], strict=True):
        if why:
            yield f"not used yet: the distance from {distance.first} to {distance.second}, for {why}"
    yield f"Kept in {session.ledger.folder}; look at them with: orthomill mark {session.project}"


@contextmanager
def _held(folder: Path, name: str) -> Iterator[None]:
    """The folder of marks for one process."""
    holder = only_run(folder)
    try:
        holder.__enter__()
    except ResourceError as error:
        if "already running" not in str(error):
            raise
        raise ResourceError(
            f"The marks of {name} are open in another process; use its page (several browsers may share it), or end it first."
        ) from None
    try:
        yield
    finally:
        holder.__exit__(None, None, None)


def with_points(marks: Marks, given: Marks) -> Marks:
    """Marks with points of a list: new ones are added, known ones get the coordinates of the list and keep their marks and role."""
    known = {point.name: point for point in given.points}
    kept = tuple(
        point.model_copy(update={"xyz": known[point.name].xyz, "sigma": known[point.name].sigma}) if point.name in known else point
        for point in marks.points
    )
    here = {point.name for point in kept}
    return marks.model_copy(update={"points": (*kept, *(point for point in given.points if point.name not in here))})


def _heights(marks: Marks) -> float | None:
    """The height of the ground by the points that have one, m."""
    known = sorted(point.xyz[2] for point in marks.points if point.xyz is not None)
    return known[len(known) // 2] if known else None
