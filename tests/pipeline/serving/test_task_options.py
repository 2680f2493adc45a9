"""Options of clients become a workflow: ours by their places, OpenDroneMap's where they mean the same, nothing in silence."""

import json
import random

import pytest
import yaml

from orthomill.pipeline.serving.node.odm_options import ODM_OPTIONS
from orthomill.pipeline.serving.node.offered_settings import TURNED
from orthomill.pipeline.serving.node.task_options import TaskOptions
from orthomill.pipeline.serving.queue.task_state import GivenOption
from orthomill.pipeline.serving.queue.wishes import Wishes, not_kept, wished_workflow, write_wished_workflow
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.errors import OrthomillError, WorkflowError
from orthomill.tasks.catalogue import STAGES

OPTIONS = TaskOptions(STAGES)
START = {
    "project": "task",
    "crs": "EPSG:32634",
    "photographs": {"kind": "folder", "path": "images"},
    "positions": {"kind": "exif"},
    "stages": [*({"kind": kind} for kind in ("photos", "calibration", "tie_points", "orientation", "epipolar")), "densification"]
    + [{"kind": kind} for kind in ("dsm_check", "terrain", "texture", "accuracy")],
}


def asked(given: dict) -> Wishes:
    return OPTIONS.wishes(GivenOption(name=name, value=value) for name, value in given.items())


def loaded(found: Wishes, folder):
    """The workflow that the options lead to, read as any other."""
    (folder / "workflows").mkdir(exist_ok=True)
    (folder / "images").mkdir(exist_ok=True)
    for name in ("a.jpg", "b.jpg"):
        (folder / "images" / name).touch()
    start = folder / "workflows" / "start.yaml"
    start.write_text(yaml.safe_dump(START))
    write_wished_workflow(start, folder / "workflows" / "task.yaml", found)
    return load_workflow(folder / "workflows" / "task.yaml", STAGES)


def test_every_default_that_is_offered_is_taken_back(tmp_path):
    given = {option.name: option.value for option in OPTIONS.listed if option.name != "crs"}
    found = loaded(asked(given), tmp_path)
    bare = loaded(Wishes(), tmp_path)
    changed = {"tie_points": {"search_side"}, "epipolar": {"level"}, "terrain": {"widest_object"}}
    for stage, own in zip(found.stages, bare.stages, strict=True):
        differing = {name for name in type(stage).model_fields if getattr(stage, name) != getattr(own, name)}
        assert differing <= changed.get(stage.kind, set()), stage.kind
    assert not asked(given).notes


def test_our_settings_reach_their_places(tmp_path):
    given = {"texture.cell": "0.1", "texture.balance": "none", "tile": "256", "tolerances.height": "0.2", "dsm_check.step": "8"}
    found = loaded(asked({**given, "crs": "EPSG:32635"}), tmp_path)
    stages = {stage.kind: stage for stage in found.stages}
    assert (stages["texture"].cell, stages["texture"].balance.kind, stages["dsm_check"].step) == (0.1, "none", 8)
    assert (found.project.crs, found.project.tile, found.project.tolerances.height) == ("EPSG:32635", 256, 0.2)


def test_the_names_of_opendronemap(tmp_path):
    given = {
        "dtm": "false",
        "pc-quality": "medium",
        "feature-quality": "high",
        "min-num-features": 4000,
        "matcher-neighbors": 12,
        "gps-accuracy": 0.05,
        "rolling-shutter": True,
        "rolling-shutter-readout": 20,
        "use-fixed-camera-params": True,
        "orthophoto-resolution": 5,
        "dem-resolution": "10",
        "max-concurrency": 3,
        "boundary": {"type": "Polygon", "coordinates": [[[21, 39], [21.01, 39], [21.01, 39.01], [21, 39]]]},
    }
    wanted = asked(given)
    found = loaded(wanted, tmp_path)
    stages = {stage.kind: stage for stage in found.stages}
    assert "terrain" not in stages and stages["epipolar"].level == 2 and stages["tie_points"].search_side == 3000
    assert (stages["tie_points"].max_features, stages["tie_points"].nearest) == (4000, 12)
    assert stages["orientation"].variation.readout == 0.02 and stages["orientation"].interior.kind == "fixed"
    assert (found.project.positions.sigma_plan, found.project.positions.sigma_height) == (0.05, 0.05)
    assert (wanted.ortho_cell, wanted.dem_cell, wanted.processes) == (0.05, 0.1, 3)
    # Central meridian of zone 34 is 21 degrees: 500 km in x, and 0.01 degree is 865 m at 39 degrees north.
    west, south, east, north = found.project.grid.area
    assert west == pytest.approx(500_000, abs=1) and east - west == pytest.approx(866, abs=2)
    assert north - south == pytest.approx(1110, abs=3)


def test_what_is_not_known_is_told_with_what_may_be_meant():
    found = asked({"dms": True, "mesh-size": 200000, "name": "x"})
    assert found.notes[0] == "Not used: the option dms means nothing to orthomill. Was dtm meant?"
    assert len(found.notes) == 2 and found.notes[1].startswith("Not used: the option mesh-size means nothing")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("tile", 100, "a multiple of 64"),
        ("texture.best", "many", "a whole number, from 0 to 64"),
        ("texture.balance", "colourful", "one of none, block, histogram"),
        ("orthophoto-resolution", -1, "a number from 0 to 100000"),
        ("orthophoto-resolution", float("nan"), "a number"),
        ("dtm", "perhaps", "true or false"),
        ("pc-quality", "best", "one of ultra, high"),
        ("boundary", "[1, 2]", "no GeoJSON polygon"),
        ("crs", "EPSG:99999999", "which PROJ does not know"),
        ("rerun-from", "x", "one of simulation, photos"),
    ],
)
def test_wrong_values_are_refused_with_what_is_allowed(name, value, words):
    with pytest.raises(WorkflowError, match=words):
        asked({name: value})


def test_all_mistakes_are_told_together():
    with pytest.raises(WorkflowError) as error:
        asked({"tile": 1, "texture.best": -1})
    assert len(str(error.value).splitlines()) == 2


def test_options_that_make_no_sense_never_end_in_anything_but_a_sentence():
    chance = random.Random(7)
    names = [*TURNED, *ODM_OPTIONS, "rerun-from", "unknown", ""]
    values = [
        None,
        "",
        True,
        -1,
        0,
        1e400,
        10**400,
        "9" * 5000,
        [],
        {},
        {"kind": "mean"},
        {"kind": []},
        "\ud800",
        [1, "x"],
        "{",
        "NaN",
    ]
    for _ in range(400):
        given = [GivenOption(name=chance.choice(names), value=chance.choice(values)) for _ in range(3)]
        try:
            found = OPTIONS.wishes(given)
            assert Wishes.model_validate_json(found.model_dump_json()) is not None
            wished_workflow(START, found.model_copy(update={"boundary": ()}))
        except OrthomillError as error:
            assert str(error)


def test_a_boundary_needs_a_system():
    wanted = Wishes(boundary=((21.0, 39.0), (21.1, 39.0), (21.0, 39.1)))
    with pytest.raises(WorkflowError, match="needs a reference system"):
        wished_workflow({**START, "crs": None}, wanted)


def test_the_accuracy_of_positions_means_nothing_without_them():
    start = {**START, "positions": {"kind": "none"}}
    wanted = asked({"gps-accuracy": 0.1})
    assert wished_workflow(start, wanted)["positions"] == {"kind": "none"}
    assert not_kept(start, wanted) == ["Not used: the accuracy of positions, for no photograph has one."]
    assert not_kept(START, wanted) == [] == not_kept(start, Wishes())


def test_wishes_survive_json():
    wanted = asked(
        {"boundary": json.dumps({"type": "Polygon", "coordinates": [[[1, 2], [2, 2], [2, 3]]]}), "tiles": True, "pc-ept": False}
    )
    assert Wishes.model_validate_json(wanted.model_dump_json()) == wanted and wanted.formats == ("xyz",) and not wanted.tiled_cloud
