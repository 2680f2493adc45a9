"""A job that does not fit its function is refused when it is planned, with the names of both."""

from collections.abc import Sequence
from typing import NamedTuple, NotRequired, TypedDict, Unpack

import numpy as np
import pytest
from pydantic import BaseModel

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.job import Job, MapFile, MapHeader, PhotoHeader, PhotoPixels, Raster, Table, TextFile
from orthomill.schemas.photo import Header
from orthomill.schemas.raster import MapGrid, Window


class Heights(BaseModel):
    mean: float


class Report(BaseModel):
    text: str


class Tile(NamedTuple):
    z: np.ndarray
    heights: Heights
    report: Report | None = None


WINDOW = Window(0, 0, 4, 4)
Z = Raster("surface/z", WINDOW)
HEIGHTS, REPORT = Table("surface/heights.json", Heights), Table("surface/report.json", Report)


def job(function, reads=None, writes=None, **params):
    return Job(
        stage="surface", item="tile", function=function, reads=reads or {}, writes=writes or {"z": Z}, params=params, row=2, col=3
    )


def mean_of(z: np.ndarray, heights: Heights, factor: float = 1.0) -> np.ndarray:
    return z * factor + heights.mean


def test_a_job_that_fits_is_not_spoken_of():
    assert misfit(job(mean_of, {"z": Z, "heights": HEIGHTS}, factor=2)) is None
    assert misfit(job(mean_of, {"z": Z, "heights": HEIGHTS})) is None


@pytest.mark.parametrize(
    ("reads", "params", "sentence"),
    [
        ({"z": Z, "height": HEIGHTS}, {}, "missing a required argument: 'heights'"),
        ({"z": Z, "heights": HEIGHTS, "more": Z}, {}, "got an unexpected keyword argument 'more'; it takes z, heights, factor"),
        ({"z": Z}, {}, "missing a required argument: 'heights'"),
        ({"z": Z, "heights": REPORT}, {}, "'heights' is read as Report, but the parameter is Heights"),
        ({"z": HEIGHTS, "heights": HEIGHTS}, {}, "'z' is read as Heights, but the parameter is ndarray"),
        ({"z": (Z, Z), "heights": HEIGHTS}, {}, "'z' is read as a tuple of ndarray, but the parameter is ndarray"),
        ({"z": Z, "heights": HEIGHTS}, {"factor": "2"}, "'factor' is given as str, but the parameter is float"),
    ],
)
def test_arguments_that_do_not_fit_are_named_with_job_and_function(reads, params, sentence):
    found = misfit(job(mean_of, reads, **params))
    assert found is not None and found.startswith("The job surface/tile/2/3 does not fit the function mean_of: ")
    assert sentence in found


class Together(TypedDict):
    z: np.ndarray
    heights: Heights
    weights: NotRequired[np.ndarray]


def mean_together(factor: float = 1.0, **reads: Unpack[Together]) -> np.ndarray:
    return reads["z"] * factor + reads["heights"].mean


@pytest.mark.parametrize(
    ("reads", "params", "sentence"),
    [
        ({"z": Z}, {}, "'heights'; it takes factor, z, heights, weights"),
        ({"z": Z, "heights": HEIGHTS, "more": Z}, {}, "got an unexpected keyword argument 'more'"),
        ({"z": Z, "heights": REPORT}, {}, "'heights' is read as Report, but the parameter is Heights"),
        ({"z": Z, "heights": HEIGHTS, "weights": HEIGHTS}, {}, "'weights' is read as Heights, but the parameter is ndarray"),
        ({"z": Z, "heights": HEIGHTS}, {"factor": "2"}, "'factor' is given as str, but the parameter is float"),
    ],
)
def test_what_is_read_together_is_examined_key_by_key(reads, params, sentence):
    assert misfit(job(mean_together, {"z": Z, "heights": HEIGHTS})) is None
    assert misfit(job(mean_together, {"z": Z, "heights": HEIGHTS, "weights": Z}, factor=2)) is None
    found = misfit(job(mean_together, reads, **params))
    assert found is not None and sentence in found


def test_regions_arrive_as_the_types_that_they_hold():
    def every(
        pixels: np.ndarray,
        header: Header,
        text: str,
        file: np.ndarray,
        place: MapGrid,
        tables: tuple[Heights, ...],
        z: Sequence[np.ndarray],
    ) -> Heights:
        raise NotImplementedError

    grid = MapGrid(west=0, north=0, cell=1, rows=4, cols=4)
    reads = {
        "pixels": PhotoPixels("a.jpg", WINDOW),
        "header": PhotoHeader("a.jpg"),
        "text": TextFile("a.csv"),
        "file": MapFile("a.tif", "EPSG:32634", grid, WINDOW),
        "place": MapHeader("a.tif", "EPSG:32634"),
        "tables": (HEIGHTS, HEIGHTS),
        "z": (Z,),
    }
    assert misfit(job(every, reads, {"heights": HEIGHTS})) is None
    assert "'text' is read as Header" in str(misfit(job(every, reads | {"text": PhotoHeader("a.jpg")}, {"heights": HEIGHTS})))
    mixed = misfit(job(every, reads | {"tables": (HEIGHTS, REPORT)}, {"heights": HEIGHTS}))
    assert "'tables' is read as a tuple of Heights and Report" in str(mixed)


def test_an_empty_tuple_of_regions_fits_any_tuple():
    def total(parts: tuple[Heights, ...] = ()) -> np.ndarray:
        raise NotImplementedError

    assert misfit(job(total, {"parts": ()})) is None


def test_a_parameter_without_annotation_is_refused():
    def doubled(z) -> np.ndarray:
        return 2 * z

    assert "parameter 'z' has no annotation" in str(misfit(job(doubled, {"z": Z})))


def both(z: np.ndarray) -> Tile:
    return Tile(z, Heights(mean=float(z.mean())))


@pytest.mark.parametrize(
    ("writes", "sentence"),
    [
        ({"z": Z, "heights": HEIGHTS}, None),
        ({"z": Z, "heights": HEIGHTS, "report": REPORT}, None),
        ({"z": Z}, "'heights' of Tile is not written, and it has no default"),
        ({"z": Z, "heights": HEIGHTS, "sigma": Z}, "the job writes 'sigma', but Tile has the fields z, heights, report"),
        ({"z": Z, "heights": REPORT}, "'heights' is written as Report, but Tile holds Heights"),
    ],
)
def test_several_results_are_the_fields_of_a_named_tuple(writes, sentence):
    found = misfit(job(both, {"z": Z}, writes))
    assert found is None if sentence is None else sentence in str(found)


def test_one_result_is_its_bare_value():
    def mean(z: np.ndarray) -> Heights:
        return Heights(mean=float(z.mean()))

    assert misfit(job(mean, {"z": Z}, {"heights": HEIGHTS})) is None
    assert "'report' is written as Report, but it returns Heights" in str(misfit(job(mean, {"z": Z}, {"report": REPORT})))
    assert "return a NamedTuple" in str(misfit(job(mean, {"z": Z}, {"heights": HEIGHTS, "z": Z})))


def test_what_may_be_none_cannot_be_the_only_result():
    def perhaps(z: np.ndarray) -> Heights | str:
        raise NotImplementedError

    assert "returns" in str(misfit(job(perhaps, {"z": Z}, {"heights": HEIGHTS})))


def test_names_that_depend_on_the_data_come_back_as_a_dict_of_one_type():
    def pages(z: np.ndarray) -> dict[str, Report]:
        return {}

    assert misfit(job(pages, {"z": Z}, {"a": REPORT, "b": REPORT})) is None
    assert "'b' is written as Heights" in str(misfit(job(pages, {"z": Z}, {"a": REPORT, "b": HEIGHTS})))


def test_a_dict_of_several_kinds_holds_any_of_them():
    def parts(z: np.ndarray) -> dict[str, Report | Heights]:
        return {}

    assert misfit(job(parts, {"z": Z}, {"a": REPORT, "b": HEIGHTS})) is None
    assert "'c' is written as ndarray" in str(misfit(job(parts, {"z": Z}, {"a": REPORT, "c": Z})))


def test_a_function_that_does_not_say_what_it_returns_is_refused():
    def silent(z: np.ndarray):
        return z

    assert "return value has no annotation" in str(misfit(job(silent, {"z": Z})))
