"""The plan of the stage: jobs, what they read and write, settings that reach them, and refusals."""

import inspect
from types import SimpleNamespace

import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, PhotoHeader, Raster, Table
from orthomill.schemas.project import CameraFromChessboards, CameraFromExif, CameraFromFile, CameraGiven
from orthomill.schemas.raster import RasterSpec
from orthomill.tasks.calibration.board_tables import ARRANGED, BOARD_PHOTOS, Arranged, ArrangedPhoto, BoardPhotos, Prediction
from orthomill.tasks.calibration.chessboards import Model
from orthomill.tasks.calibration.plan.chessboard_jobs import _model
from orthomill.tasks.calibration.stage import CalibrationStage

BOARDS = BoardPhotos(paths=("boards/a.jpg", "boards/b.jpg"), size=(2400, 1600))
SOURCE = {"kind": "chessboards", "photographs": {"kind": "simulated"}, "corners": (9, 6), "square": 0.05}


class PlanView:
    """A project whose boards were indexed and identified: the second photograph is searched again."""

    def __init__(self, cameras, photos: bool = True):
        self.project, self.photos = SimpleNamespace(cameras=cameras), photos

    def image_files(self, source, simulated_folder: str) -> tuple[str, ...]:
        return BOARDS.paths

    def table(self, table: Table):
        missed = (Prediction(board=0, pixels=((1.0, 1.0),)),)
        photos = (
            ArrangedPhoto(photo="a", names=(0,), certain=True),
            ArrangedPhoto(photo="b", names=(), certain=True, predictions=missed),
        )
        return {BOARD_PHOTOS: BOARDS, ARRANGED: Arranged(boards=1, photos=photos)}[table]

    def has_stage(self, kind: str) -> bool:
        return self.photos


def planned(cameras, photos: bool = True, **settings) -> list[RasterSpec | Job | Export]:
    return list(CalibrationStage(**settings).plan(PlanView(cameras, photos)))


def boards(**changes) -> CameraFromChessboards:
    return CameraFromChessboards.model_validate({**SOURCE, **changes})


def job(plan, item: str) -> Job:
    return next(own for own in plan if isinstance(own, Job) and own.item == item)


@pytest.mark.parametrize(
    ("source", "reads", "params"),
    [
        (CameraFromExif(kind="exif"), {"photos"}, set()),
        (CameraGiven(kind="given", c=900.0, serves="a*"), {"photos"}, {"given"}),
        (CameraFromFile(kind="file", path="c.json", serves="a*"), {"photos", "text"}, {"path", "serves"}),
    ],
)
def test_cameras_that_are_known_take_one_job(source, reads, params):
    (only,) = planned(source)
    assert set(only.reads) == reads and set(only.params) == params and set(only.writes) == {"cameras", "report"}
    inspect.signature(only.function).bind(**only.reads, **only.params)


def test_the_files_of_a_calibration_are_those_of_the_setting():
    (only,) = planned(CameraFromFile(kind="file", path="c.json", serves="a*"))
    assert only.params == {"path": "c.json", "serves": "a*"} and only.reads["text"].path == "c.json"


def test_every_job_of_the_chessboards_fits_its_function():
    plan = planned(boards())
    jobs = [own for own in plan if isinstance(own, Job)]
    assert [own.item for own in jobs] == [
        "chessboards",
        "corners a",
        "corners b",
        "arrangement",
        "second search b",
        "cameras",
        "drawing a",
        "drawing b",
    ]
    for own in jobs:
        inspect.signature(own.function).bind(**own.reads, **own.params)
        returned = inspect.signature(own.function, eval_str=True).return_annotation
        assert len(own.writes) == 1 or set(own.writes) == set(returned._fields)


def test_photographs_are_read_whole_and_drawn_in_reduced_size():
    plan = planned(boards())
    specs = {own.name: own.shape for own in plan if isinstance(own, RasterSpec)}
    assert specs["calibration/overview/a"] == (400, 600) and specs["calibration/boards/a"] == (400, 600, 3)
    search = job(plan, "corners a")
    assert search.reads["pixels"].window.shape == (1600, 2400) and search.scratch > 3 * 1600 * 2400
    assert isinstance(search.writes["overview"], Raster) and job(plan, "chessboards").reads["headers"][0] == PhotoHeader(
        "boards/a.jpg"
    )


def test_the_settings_of_the_boards_reach_the_jobs():
    plan = planned(boards(boards=3, arrangement="space", sigma_in_plane=1e-4, sigma_height=2e-4, bend=0.02, serves="DSC*"))
    target, params = job(plan, "arrangement").params["target"], job(plan, "cameras").params
    assert (target.size, target.corners, target.square, target.boards) == ((2400, 1600), (9, 6), 0.05, 3)
    assert (target.arrangement, target.sigma_in_plane, target.sigma_height) == ("space", 1e-4, 2e-4)
    assert target.bend == 0.02 and job(planned(boards()), "arrangement").params["target"].bend == 0.005
    assert params["target"] == target and params["serves"] == "DSC*" and job(plan, "corners a").params["boards"] == 3


@pytest.mark.parametrize(("sigma", "exact"), [({}, True), ({"sigma_in_plane": 1e-4}, False), ({"sigma_height": 1e-4}, False)])
def test_any_part_of_a_board_equals_another_only_if_boards_are_exact(sigma, exact):
    assert job(planned(boards(**sigma)), "corners a").params["exact"] is exact


def test_only_photographs_that_lack_boards_are_searched_again():
    plan = planned(boards())
    again = job(plan, "second search b")
    assert again.reads["arranged"] is ARRANGED and again.reads["pixels"].path == "boards/b.jpg"
    assert again.writes["corners"] in job(plan, "cameras").reads["completed"] and len(job(plan, "cameras").reads["completed"]) == 1


def test_without_photographs_the_calibration_is_run_alone():
    assert "photos" in job(planned(boards()), "cameras").reads
    assert "photos" not in job(planned(boards(), photos=False), "cameras").reads


def test_the_camera_is_exported_in_every_format():
    exports = [own for own in planned(boards()) if isinstance(own, Export)]
    assert [own.path for own in exports] == [
        "products/camera.json",
        "products/calibration.json",
        "products/camera_opencv.yaml",
        "products/camera_colmap.txt",
        "products/camera_opensfm.json",
        "products/camera_agisoft.xml",
    ]
    written = job(planned(boards()), "cameras").writes.values()
    assert all(table in written for own in exports for table in own.tables), "every export has a writer"


def test_parameters_are_estimated_in_their_order_and_need_c():
    assert _model(()).free is None and _model(("k1", "c", "affinity")).free == ("c", "k1", "affinity")
    assert job(planned(boards(), parameters=("k1", "c")), "cameras").params["model"].free == ("c", "k1")
    with pytest.raises(WorkflowError, match="must hold c"):
        planned(boards(), parameters=("x0", "k1"))


@pytest.mark.parametrize("source", [CameraFromExif(kind="exif"), CameraGiven(kind="given", c=900.0)], ids=lambda one: one.kind)
def test_parameters_are_refused_where_nothing_estimates_them(source):
    with pytest.raises(WorkflowError, match=rf"parameters \(c, k1\) have no effect with cameras of kind: {source.kind}.*remove"):
        planned(source, parameters=("c", "k1"))
    assert len(planned(source)) == 1


@pytest.mark.parametrize("corners", [(2, 5), (4, 1)])
def test_boards_with_too_few_corners_are_refused(corners):
    with pytest.raises(WorkflowError, match=rf"{corners[0]} x {corners[1]} inner corners; both numbers must be at least 3"):
        planned(boards(corners=corners))


def test_boards_without_a_first_corner_are_refused_only_where_their_corners_are_uncertain():
    assert job(planned(boards(corners=(8, 6))), "chessboards")
    with pytest.raises(WorkflowError, match=r"8 x 6 inner corners looks the same after half a turn.*remove them"):
        planned(boards(corners=(8, 6), sigma_height=0.001))


def test_the_lens_of_a_calibration_is_chosen_or_stated():
    assert job(planned(boards()), "cameras").params["model"].lens is None
    assert job(planned(boards(), model="fisheye"), "cameras").params["model"] == Model(None, "fisheye")
    stated = job(planned(boards(), model="rational", parameters=("k4", "c", "k1")), "cameras").params["model"]
    assert stated == Model(("c", "k1", "k4"), "rational")
    with pytest.raises(WorkflowError, match=r"parameters k4 are none of a lens of the model brown, which has c.*name the model"):
        planned(boards(), parameters=("c", "k4"))
    with pytest.raises(WorkflowError, match=r"model \(division\) have no effect"):
        planned(CameraFromExif(kind="exif"), model="division")
