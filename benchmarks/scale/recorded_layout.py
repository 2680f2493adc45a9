"""The jobs of a finished run, and of a project that many blocks like it make up."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, sqrt
from pathlib import Path

import numpy as np

from benchmarks.scale.job_counts import LARGER, GoesBy, Spread, planned_with, spread_of
from benchmarks.scale.simulated_cluster import Jobs
from orthomill.pipeline.engine.foresight import photograph_pixels
from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.running import session_of
from orthomill.pipeline.export.file_parts import SHEET
from orthomill.pipeline.forecast.known_costs import family_of
from orthomill.pipeline.records.records import Record
from orthomill.pipeline.workflow.workflow_file import load_workflow, resolve_workflow
from orthomill.schemas.job import Export, Job, Stream
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import Project
from orthomill.schemas.raster import RasterSpec
from orthomill.tasks.catalogue import STAGES

JOINING = 0.1
"""processor time of the job that joins the parts of a file, for that of all parts: 0.43 s for 4.22 s of heights and 0.34 s for
3.55 s of an orthoimage of 8192 x 4200 px, 0.38 s for 6.5 s of a point cloud"""
GROWING = {"photograph_differences": 0.0, "export areas codes": 0.3, "balanced_block": 0.05}
"""share of a job that a project has once which takes longer in a larger one, where not all of it does: 300 points, of 2400 that
are looked at at most (10.0, 9.2, 11.3 and 10.1 CPU-s for 6, 18, 15 and 39 photographs, 5.7 for 1008 with 1.2 million rays); the
outlines of a picture of 4000 px, for which all is read (0.4 to 0.7 of 1.8 CPU-s of volos)"""
BY_PHOTOGRAPH = {"orient_block", "relate_pairs", "index_photos", "measured_pairs", "balanced_block"}
"""functions of jobs that a project has once, and that see no pixels: they take as long as there are photographs, each of which has
at most `max_features` points (8000), however large it is"""
MORE_EACH = 2.0
"""times as long for each photograph of a large block as for one of six: 1.39 and 0.79 CPU-s of orient_block in blocks of 41 and
42, 0.62 in one of six with more rays each (0.13, 0.06 and 0.07 in simulated flights of 24, 96 and 400 with fewer rays); in the
adjustment alone 43 ms of 50 photographs, 82 of 1000 (adjustment_growth.md)"""
LEFT_OUT = ("simulation", "evaluation", "calibration")
"""stages of simulated projects alone, and chessboards, of which a larger project has no more"""


LISTED = 0.05
"""processor time of the job that joins sheets, s: it names them, and reads none (0.03 s for 400)"""


@dataclass(frozen=True)
class RasterFile:
    """A GeoTIFF that goes in parts: the numbers of the job that makes a part and of the one that joins them, its `rows` and `cols`,
    and its bytes, not compressed."""

    part: int
    joining: int
    rows: int
    cols: int
    size: int

    def sheets(self, grown: float) -> int:
        """How many it has in a project of `grown` times the ground, as the planner counts them."""
        return ceil(self.rows * sqrt(grown) / SHEET) * ceil(self.cols * sqrt(grown) / SHEET)


@dataclass(frozen=True, eq=False)
class Layout:
    """A block of so many megapixels in so many photographs."""

    megapixels: float
    photographs: int
    tile: int
    jobs: Jobs
    spread: Spread
    """what the number of each job goes by"""
    stored: float
    """bytes that are kept, of a megapixel"""
    growing: np.ndarray
    """(N,) share of a job that is made once which takes longer in a larger project"""
    by_photograph: np.ndarray
    """(N,) whether it does with the number of photographs, not with their pixels"""
    counts: tuple[tuple[int, int, int], ...] = ()
    """side of a tile, jobs of the real plan with it, and as many as are counted"""
    files: tuple[RasterFile, ...] = ()
    sheets_above: float = 1e9 * Project.model_fields["sheets_above"].default
    """bytes of a file, not compressed, above which it is in sheets"""

    @property
    def once(self) -> np.ndarray:
        """(N,) whether a job is made once for a whole project, however large."""
        return self.spread.goes == GoesBy.ONCE

    @property
    def core_seconds(self) -> float:
        """Of a megapixel."""
        return float(self.jobs.seconds.sum()) / self.megapixels


def layout_of(project: str) -> Layout:
    """The jobs of the finished run of a project of this folder, without stages that no larger project has more of.

    The run must have found its kernels compiled: a job that is made once, and compiles, would count for a thousand times as much.
    """
    loaded = load_workflow(resolve_workflow(project, Path.cwd()), STAGES)
    session = session_of(loaded)
    session.plan()
    if session.pending or session.planner.open_stages:
        raise SystemExit(f"{project} is not finished by this version of the program: run it, then measure.")
    kept = [planned for key, planned in session.graph.jobs.items() if key[0] not in LEFT_OUT]
    records = [session.records.get(planned.key) for planned in kept]
    place = {planned.key: number for number, planned in enumerate(kept)}
    before = [[place[key] for key in planned.dependencies if key in place] for planned in kept]
    jobs = Jobs(
        np.array([record.cpu_seconds if record else 0.0 for record in records]),
        np.array([len(found) for found in before]),
        np.array([len(record.files) if record else 0 for record in records]),
        np.array([_bytes(planned, record) for planned, record in zip(kept, records, strict=True)], float),
        np.concatenate(([0], np.cumsum([len(found) for found in before]))),
        np.array([one for found in before for one in found], int),
        np.array([_streams(planned.job) for planned in kept]),
    )
    megapixels = photograph_pixels(session) / 1e6
    stored = sum(kept.size for record in records if record for kept in record.files.values())
    names = [family_of(planned)[1] for planned in kept]
    growing = np.array([GROWING.get(name, 1.0) for name in names])
    by_photograph = np.array([name in BY_PHOTOGRAPH for name in names])
    photographs = len(session.store.table(PHOTOS).photos)
    tile = session.project.tile
    plans = {side: planned_with(loaded, side, LEFT_OUT) for side in (tile, 2 * tile, LARGER * tile)}
    spread = spread_of(kept, plans[LARGER * tile])
    counts = tuple((side, len(plan), round(spread.numbers(1.0, 1.0, side / tile).sum())) for side, plan in plans.items())
    layout = Layout(megapixels, photographs, tile, jobs, spread, stored / megapixels, growing, by_photograph, counts)
    parted = np.array([_goes_in_parts(planned) for planned in kept])
    return replace(with_parts(layout, parted), files=tuple(_raster_files(kept, parted, session.graph.specs)))


def _raster_files(kept: Sequence[PlannedJob], parted: np.ndarray, specs: Mapping[str, RasterSpec]) -> Iterator[RasterFile]:
    """The GeoTIFFs among the files that go in parts."""
    for place, number in enumerate(np.flatnonzero(parted).tolist()):
        job = kept[number].job
        if isinstance(job, Export) and job.format == "cog":
            held = [specs[name] for name in job.rasters.values()]
            size = sum(spec.bytes_of(spec.full) for spec in held)
            yield RasterFile(number, len(kept) + place, *held[0].full.shape, size)


def _streams(job: Job | Export) -> bool:
    """Whether a job reads one object after the other: files are made block by block."""
    # Of a group of a stream several are on their way at a time.
    return isinstance(job, Export) or any(isinstance(one, Stream) and not one.in_groups for one in job.reads.values())


def _goes_in_parts(planned: PlannedJob) -> bool:
    """Whether a larger project makes a file in parts, as it is done for rasters above 4096 px."""
    job = planned.job
    return isinstance(job, Export) and job.format in ("cog", "laz") and bool(job.rasters) and not job.tables


def with_parts(layout: Layout, parted: np.ndarray) -> Layout:
    """The same where the jobs that are `parted` (N,) make a part of a file for each block, and one job for all joins them."""
    jobs, numbers = layout.jobs, np.flatnonzero(parted)
    joining = len(jobs.seconds) + np.arange(len(numbers))
    # What waited for a file waits for the job that joins it.
    renamed = np.arange(len(jobs.seconds))
    renamed[numbers] = joining
    ones = np.ones(len(numbers), int)
    larger = Jobs(
        np.append(jobs.seconds, JOINING * jobs.seconds[numbers]),
        np.append(jobs.reads, ones),
        np.append(jobs.writes, ones),
        # They are read and written as they are; what a part read of the store is not told apart.
        np.append(jobs.bytes, jobs.bytes[numbers]),
        np.append(jobs.first, jobs.first[-1] + np.cumsum(ones)),
        np.append(renamed[jobs.before], numbers),
        np.append(jobs.streamed, ones > 0),
    )
    more = np.ones(len(numbers), bool)
    return replace(
        layout,
        jobs=larger,
        spread=layout.spread.with_parts(parted),
        growing=np.append(layout.growing, 1.0 * more),
        by_photograph=np.append(layout.by_photograph, ~more),
    )


def _bytes(planned: PlannedJob, record: Record | None) -> int:
    """Bytes through the network: what it wrote, and as much for what it reads as its pixels are more than that."""
    written = sum(kept.size for kept in record.files.values()) if record else 0
    share = planned.data_bytes / planned.output_bytes if planned.output_bytes else 2.0
    return int(written * max(share, 1.0))


def enlarged(layout: Layout, megapixels: float, photographs: float, tile: int) -> Jobs:
    """The jobs of a project of so many megapixels and photographs with such tiles: blocks like this one side by side.

    Jobs that are made once grow with the project, by its pixels or by its photographs, unless they are known not to; of all others
    there are more, and each does as much more.
    """
    once = layout.once
    grown, each = megapixels / layout.megapixels, photographs / layout.photographs
    numbers = np.maximum(np.rint(layout.spread.numbers(grown, each, tile / layout.tile)), 1).astype(int)
    in_sheets = [file for file in layout.files if file.size * grown > layout.sheets_above]
    numbers[[file.part for file in in_sheets]] = [file.sheets(grown) for file in in_sheets]
    jobs = _listing(layout.jobs, np.array([file.joining for file in in_sheets], int))
    each = max(each, 1.0)
    larger = np.where(layout.by_photograph, each * min(each, MORE_EACH), grown)
    larger[[file.joining for file in in_sheets]] = 1.0
    factor = np.where(once, 1.0 + layout.growing * (larger - 1.0), grown / numbers)
    first, before = _repeated_dependencies(jobs, once, numbers)
    # What is read of each job before is read of each of its copies, but by those that look at samples.
    waited = np.maximum(np.repeat(np.diff(jobs.first), numbers), 1)
    sampled = np.repeat(once & (layout.growing == 0), numbers)
    reads = np.repeat(jobs.reads, numbers) * np.where(sampled, 1, np.diff(first) / waited)
    return Jobs(
        np.repeat(jobs.seconds * factor, numbers),
        np.rint(np.where(np.diff(first) > 0, reads, np.repeat(jobs.reads, numbers))).astype(int),
        np.repeat(jobs.writes, numbers),
        np.repeat(jobs.bytes * factor, numbers),
        first,
        before,
        np.repeat(jobs.streamed, numbers),
    )


def _listing(jobs: Jobs, joining: np.ndarray) -> Jobs:
    """The same where the jobs that are `joining` read no part: one list, and a file that names what is in it."""
    seconds, reads, size = jobs.seconds.copy(), jobs.reads.copy(), jobs.bytes.copy()
    seconds[joining], reads[joining], size[joining] = LISTED, 0, 0.0
    return jobs._replace(seconds=seconds, reads=reads, bytes=size)


def _repeated_dependencies(jobs: Jobs, once: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is made once waits for all copies; another copy for those that cover the same part of the project."""
    begins, counts, before = np.concatenate(([0], np.cumsum(numbers))), [], []
    for number, copies in enumerate(numbers):
        every = np.arange(1 if once[number] else copies)
        waiting, found = [every[:0]], [every[:0]]
        for one in jobs.before[jobs.first[number] : jobs.first[number + 1]]:
            start, end = every * numbers[one] // len(every), -(-(every + 1) * numbers[one] // len(every))
            width = end - start
            waiting.append(np.repeat(every, width))
            found.append(
                begins[one] + np.repeat(start - np.concatenate(([0], np.cumsum(width)[:-1])), width) + np.arange(width.sum())
            )
        order = np.argsort(np.concatenate(waiting), kind="stable")
        counts.append(np.bincount(np.concatenate(waiting), minlength=len(every)))
        before.append(np.concatenate(found)[order])
    return np.concatenate(([0], np.cumsum(np.concatenate(counts)))), np.concatenate(before).astype(int)
