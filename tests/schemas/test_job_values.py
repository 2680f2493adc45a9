"""Jobs, regions and tables as values: they name what is read and written, and hold together what belongs together."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import GeometryError, OrthomillError, PhotoError, ResourceError, StoreError, WorkflowError, some_of
from orthomill.schemas.inspections.inspection import PhotoMap
from orthomill.schemas.job import Columns, Export, Job, Raster, Table
from orthomill.schemas.observations import GROUND_POINTS, IMAGE_RESIDUALS, TIE_POINTS, GroundPoints, TiePoints
from orthomill.schemas.raster import Window
from orthomill.schemas.stage_contract import NotYet, Stage
from orthomill.schemas.truth import ControlRows, MeasurementRows, PositionRows


@dataclass(frozen=True)
class Rows(Columns):
    """Two columns."""

    number: np.ndarray
    name: np.ndarray


def rows(count: int) -> Rows:
    return Rows(np.arange(count), np.array([f"n{index}" for index in range(count)]))


@settings(max_examples=60, deadline=None)
@given(count=st.integers(0, 30), seed=st.integers(0, 99))
def test_taking_rows_takes_them_from_every_column(count, seed):
    index = np.random.default_rng(seed).integers(0, count, 7) if count else np.zeros(0, int)
    taken = rows(count).take(index)
    assert len(taken) == len(index) and isinstance(taken, Rows)
    assert all(name == f"n{number}" for number, name in zip(taken.number, taken.name, strict=True))


@settings(max_examples=60, deadline=None)
@given(count=st.integers(1, 30), seed=st.integers(0, 99))
def test_taking_twice_is_taking_the_taken_index(count, seed):
    first, second = np.random.default_rng(seed).integers(0, count, (2, count))
    twice, once = rows(count).take(first).take(second), rows(count).take(first[second])
    assert np.array_equal(twice.number, once.number) and np.array_equal(twice.name, once.name)


def test_taking_rows_keeps_the_types_of_the_columns():
    one = TiePoints(np.arange(3, dtype=np.int32), np.zeros(3, np.int32), np.ones(3), np.ones(3), np.ones(3, np.float32))
    taken = one.take(one.track > 0)
    assert [getattr(taken, name).dtype for name in ("track", "photo", "col", "sigma")] == ["int32", "int32", "float64", "float32"]
    assert len(taken) == 2 and len(one) == 3 and len(one.take(np.zeros(0, int))) == 0


def test_rows_that_do_not_exist_cannot_be_taken():
    for index in (np.array([3]), np.array([True, False])):
        with pytest.raises(IndexError):
            rows(3).take(index)


def test_a_mask_takes_rows_too():
    assert list(rows(5).take(rows(5).number % 2 == 0).name) == ["n0", "n2", "n4"]


def test_columns_of_different_length_are_refused_with_their_names():
    with pytest.raises(ValueError, match=r"columns of Rows differ in length: \{'number': 2, 'name': 3\}"):
        Rows(np.arange(2), np.array(["a", "b", "c"]))


@pytest.mark.parametrize("kind", [TiePoints, GroundPoints, PositionRows, ControlRows, MeasurementRows])
def test_tables_of_observations_have_one_length(kind):
    names = list(kind.__dataclass_fields__)
    assert len(kind(*(np.zeros(4) for _ in names))) == 4
    with pytest.raises(ValueError, match="differ in length"):
        kind(np.zeros(3), *(np.zeros(4) for _ in names[1:]))


def test_long_tables_are_stored_as_parquet_under_the_stage_that_writes_them():
    assert {table.path for table in (TIE_POINTS, GROUND_POINTS, IMAGE_RESIDUALS)} == {
        "tie_points/tie_points.parquet",
        "orientation/points.parquet",
        "orientation/image_residuals.parquet",
    }


def test_a_job_is_identified_by_its_stage_item_and_tile():
    job = Job(stage="texture", item="tile", function=len, reads={}, writes={}, row=3, col=4)
    assert job.key == ("texture", "tile", 3, 4) and job.scratch == 0 and job.params == {}
    assert (
        Job(stage="texture", item="tile", function=len, reads={}, writes={}).key
        == Export("texture", "tile", "products/a.tif", "cog").key
    )


def test_regions_and_tables_are_values():
    assert Raster("a", Window(0, 0, 1, 1)) == Raster("a", Window(0, 0, 1, 1)) != Raster("b", Window(0, 0, 1, 1))
    assert Table("a.json", Rows) == Table("a.json", Rows) != Table("a.json", Rows, readers=("b",))
    assert len({Table("a.json", Rows), Table("a.json", Rows)}) == 1


def test_a_stage_has_to_say_how_it_is_planned():
    class Empty(Stage):
        """Nothing."""

        title = "Empty"
        kind: str = "empty"

    with pytest.raises(NotImplementedError):
        Empty().plan(None)


def test_a_photo_map_gives_its_strips_once():
    found = PhotoMap((4, 3), iter([np.zeros((2, 3), np.uint8), np.ones((2, 3), np.uint8)]), {0: "none", 1: "one"})
    assert np.concatenate(list(found.strips)).shape == found.shape and not list(found.strips) and found.notes == ()


# --- errors ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [WorkflowError, PhotoError, GeometryError, StoreError, ResourceError])
def test_every_error_that_can_be_explained_is_of_one_family(kind):
    with pytest.raises(OrthomillError, match=r"a\.jpg is empty; copy it again"):
        raise kind("a.jpg is empty; copy it again.")


@pytest.mark.parametrize("kind", [WorkflowError, PhotoError, GeometryError, StoreError, ResourceError])
def test_one_kind_of_error_is_not_handled_as_another(kind):
    others = {WorkflowError, PhotoError, GeometryError, StoreError, ResourceError} - {kind}
    assert not issubclass(kind, tuple(others)) and str(kind("a.jpg is empty.")) == "a.jpg is empty."


def test_planning_signals_are_no_errors_for_users():
    assert not issubclass(NotYet, OrthomillError)


@settings(max_examples=60, deadline=None)
@given(names=st.lists(st.text("abc", min_size=1, max_size=3), max_size=20), most=st.integers(1, 10))
def test_a_long_list_of_names_is_cut_and_counted(names, most):
    text = some_of(names, most)
    assert text.startswith(", ".join(names[:most]))
    assert (f" and {len(names) - most} more" in text) == (len(names) > most)
    assert text.count(",") == max(min(len(names), most) - 1, 0)
