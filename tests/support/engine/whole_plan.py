"""Plans a project to its last job without doing one: tables on which planning waits have made-up values, of the right size."""

from pathlib import Path

import numpy as np

from orthomill.pipeline.engine.foresight import plan_ahead
from orthomill.pipeline.engine.session import Session
from orthomill.schemas.camera import Camera
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import Job, Table, regions_of
from orthomill.schemas.observations import CONTROL, GROUND_POINTS, TIE_POINT_COUNTS, Control, GroundPoints, TiePointCounts
from orthomill.schemas.orientation import BLOCK, Block, ExteriorOrientation
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.stage_report import Picture, StageReport, Verdict, report_table
from orthomill.schemas.surface import HEIGHT, SURFACE
from orthomill.schemas.truth import TRUTH_BLOCK
from orthomill.tasks.calibration.board_tables import ARRANGED, BOARD_PHOTOS, Arranged, BoardPhotos
from orthomill.tasks.dsm_check.rounds.round_state import RoundCounts, RoundState, state_table
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import choose_pairs
from orthomill.tasks.texture.ground.relief import RELIEF, SIDE, Relief
from orthomill.tasks.tie_points.match_records import Links, MatchCounts
from orthomill.tasks.tie_points.plan.tie_point_tables import LINKS, MATCH_COUNTS

FLYING_HEIGHT = 60.0
"""m: of a block whose photographs are known by their tags alone"""


def plan_whole(session: Session) -> None:
    """Plan as far as made-up tables lead; `session.planner.waiting_for` says what still waits."""
    given = plan_ahead(session).tables
    for stage in session.stages:
        pictures = (Picture(title="Made up", raster=HEIGHT, style="hillshade"),) if stage.kind == "densification" else ()
        given[report_table(stage.kind).path] = StageReport(verdict=Verdict(level="good", sentence="Made up."), pictures=pictures)
    given[CONTROL.path] = Control()
    known = -1
    while len(given) > known:
        known = len(given)
        _make_up(session, given)
        _do_light_jobs(session, given)
        with session.planner.expecting(given):
            session.plan()


def _do_light_jobs(session: Session, given: dict) -> None:
    """Those that choose and describe: they read nothing but tables that are known, and take no time."""
    for planned in session.graph.jobs.values():
        job = planned.job
        if not isinstance(job, Job) or job.item not in ("truth", "pairs", "grid", "surface", "frames", "census", "blocks"):
            continue
        regions = [region for reading in job.reads.values() for region in regions_of(reading)]
        wanted = [region.path for region in job.writes.values() if isinstance(region, Table)]
        light = all(isinstance(region, Table) and region.path in given for region in regions) and len(wanted) == len(job.writes)
        if light and not given.keys() >= set(wanted):
            values = job.function(
                **{
                    name: tuple(given[one.path] for one in reading) if isinstance(reading, tuple) else given[reading.path]
                    for name, reading in job.reads.items()
                },
                **job.params,
            )
            found = values._asdict() if hasattr(values, "_fields") else {next(iter(job.writes)): values}
            given.update({region.path: found[name] for name, region in job.writes.items()})


def _make_up(session: Session, given: dict) -> None:
    """Values of tables that need photographs, from those that are known."""
    if TRUTH_BLOCK.path in given:
        given.setdefault(PHOTOS.path, _photos_of(given[TRUTH_BLOCK.path], session.planner.image_files(session.project.photographs)))
    if PHOTOS.path not in given:
        return
    photos: Photos = given[PHOTOS.path]
    count = len(photos.photos)
    block = given.setdefault(BLOCK.path, given.get(TRUTH_BLOCK.path) or _block_of_tags(photos, session.project.crs))
    links = tuple((i, i + 1) for i in range(count - 1))
    usual = {
        MATCH_COUNTS.path: MatchCounts(matches=1000 * count, features=2000 * count),
        LINKS.path: Links(pairs=links, tracks=500 * count, conflicts=0),
        TIE_POINT_COUNTS.path: TiePointCounts(points=500 * count, rays=1500 * count),
        GROUND_POINTS.path: _points_on(block),
        BOARD_PHOTOS.path: BoardPhotos(paths=session.graph.exported_files("chessboards"), size=(1000, 800)),
        ARRANGED.path: Arranged(boards=1, photos=()),
        state_table(1).path: RoundState(counts=RoundCounts(judged=1)),
    }
    given.update({path: value for path, value in usual.items() if path not in given})
    if session.planner.has_stage("epipolar"):
        given.setdefault(PAIRS.path, choose_pairs(block, PairChoice(), 0.1))
    if SURFACE.path in given:
        grid = given[SURFACE.path].grid
        row, col = (axis.ravel().astype(np.int32) for axis in np.indices((-(-grid.rows // SIDE), -(-grid.cols // SIDE))))
        level = np.full(len(row), block.ground_mean, np.float32)
        given.setdefault(RELIEF.path, Relief(row, col, level, level))


def _points_on(block: Block) -> GroundPoints:
    """A tie point below every photograph, at the mean height of the ground."""
    x, y, _ = np.array([photo.centre for photo in block.photos]).T
    count = len(x)
    sigma, rays = np.full(count, 0.1, np.float32), np.full(count, 3, np.int16)
    return GroundPoints(np.arange(count, dtype=np.int32), x, y, np.full(count, block.ground_mean), sigma, sigma, sigma, rays, sigma)


def _photos_of(block: Block, paths: tuple[str, ...]) -> Photos:
    """Photographs as a simulation exports them."""
    photos = []
    for path in paths:
        name = Path(path).stem
        c = block.camera_of(name)
        size = {"width": c.width, "height": c.height}
        photos.append(Photo(name=name, path=path, bands=3, dtype="uint8", camera=c.name, levels=4, **size))
    return Photos(photos=tuple(photos))


def _block_of_tags(photos: Photos, crs: str) -> Block:
    """A block of photographs that look straight down from their positions, or stand in a row where they have none."""
    cameras = {p.camera: Camera(name=p.camera, width=p.width, height=p.height, c=float(p.width)) for p in photos.photos}
    places = [p.position or (20.0 * i, 0.0, FLYING_HEIGHT) for i, p in enumerate(photos.photos)]
    lowest = min(z for _, _, z in places) - FLYING_HEIGHT
    return Block(
        crs=crs,
        cameras=cameras,
        of_photo={p.name: p.camera for p in photos.photos},
        photos=tuple(
            ExteriorOrientation(photo=p.name, centre=place, omega_phi_kappa=(0.0, 0.0, 0.0))
            for p, place in zip(photos.photos, places, strict=True)
        ),
        datum="Made up.",
        sigma0_px=0.3,
        redundancy=100,
        iterations=3,
        ground_low=lowest - 5.0,
        ground_high=lowest + 5.0,
    )
