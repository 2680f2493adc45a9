"""The ledger of marks: no mark is lost, no page overwrites another, and the stage `orientation` reads its files."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from orthomill.pipeline.serving.marking.mark_ledger import (
    CHANGES,
    LEDGER,
    DistanceChange,
    MarkChange,
    MarkLedger,
    OvertakenError,
    PointChange,
    PointFields,
)
from orthomill.pipeline.serving.marking.mark_tables import left_out, mark_files
from orthomill.schemas.errors import StoreError
from orthomill.schemas.marks import Mark
from orthomill.schemas.observations import Distance
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.orientation.control.control_files import read_control

SIZES = {"a.jpg": (100, 80), "b.jpg": (100, 80)}
GROUND = PointFields(name="P 1", xyz=(10.0, 20.0, 30.0))
TIE = PointFields(name="T", role="tie")


def ledger(folder):
    return MarkLedger(folder, "EPSG:32632", SIZES)


def marked(point, photo, col, before=None):
    return MarkChange(kind="mark", point=point, photo=photo, before=before, after=Mark(col=col, row=7.25))


def filled(folder):
    found = ledger(folder)
    for fields in (GROUND, TIE):
        found.apply(PointChange(kind="point", before=None, after=fields))
    for photo in SIZES:
        found.apply(marked("P 1", photo, 5.0))
        found.apply(marked("T", photo, 6.0))
    found.apply(DistanceChange(kind="distance", before=None, after=Distance(first="P 1", second="T", length=2.0, sigma=0.001)))
    return found


def test_everything_is_there_again_after_the_process_ends(tmp_path):
    assert ledger(tmp_path).is_new
    before = filled(tmp_path).marks
    again = ledger(tmp_path)
    assert again.marks == before and not again.is_new
    assert [point.name for point in again.marks.points] == ["P 1", "T"]


def test_the_files_are_those_that_the_orientation_reads(tmp_path):
    filled(tmp_path)
    photos = Photos(
        photos=tuple(Photo(name=name, path=name, width=100, height=80, bands=1, dtype="uint8", camera="c") for name in SIZES)
    )
    texts = [(tmp_path / name).read_text() for name in ("points.csv", "measurements.csv", "distances.csv")]
    control = read_control(photos, *texts)
    assert {point.name: point.role for point in control.points} == {"P 1": "control", "T": "tie"}
    assert control.points[0].measurements["a.jpg"] == (5.0, 7.25, 0.5)
    assert control.distances[0].length == 2.0
    lines = (tmp_path / "gcp_list.txt").read_text().splitlines()
    assert lines[0] == "EPSG:32632" and lines[1] == "10.0000 20.0000 30.0000 5.000 7.250 a.jpg P_1" and len(lines) == 3


def test_a_point_that_no_adjustment_can_use_is_kept_but_not_given_to_one(tmp_path):
    found = filled(tmp_path)
    found.apply(PointChange(kind="point", before=GROUND, after=GROUND.model_copy(update={"role": "unused"})))
    found.apply(MarkChange(kind="mark", point="T", photo="a.jpg", before=Mark(col=6.0, row=7.25), after=None))
    assert (tmp_path / "points.csv").read_text().splitlines() == ["name,role,x,y,z,sigma_x,sigma_y,sigma_z"]
    assert len(ledger(tmp_path).marks.points) == 2


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"role": "check"}, ""),
        ({"role": "unused"}, "P 1 is unused"),
        ({"xyz": None}, "P 1 has no coordinates"),
        ({"marks": {}}, "P 1 has 0 of the 1 marks"),
        ({"role": "check", "marks": {"a.jpg": Mark(col=1.0, row=1.0)}}, "P 1 has 1 of the 2 marks"),
    ],
)
def test_a_distance_is_given_to_the_adjustment_or_its_reason_is_told(tmp_path, change, why):
    marks = filled(tmp_path).marks
    changed = marks.model_copy(update={"points": (marks.points[0].model_copy(update=change), marks.points[1])})
    assert left_out(changed.distances[0], changed).startswith(why) and bool(left_out(changed.distances[0], changed)) == bool(why)
    assert ("P 1,T,2.0" in mark_files(changed, "EPSG:32632")["distances.csv"]) == (not why)


def test_two_pages_do_not_overwrite_each_other(tmp_path):
    found = filled(tmp_path)
    seen = Mark(col=5.0, row=7.25)
    found.apply(marked("P 1", "a.jpg", 9.0, before=seen))
    with pytest.raises(OvertakenError, match="another page"):
        found.apply(marked("P 1", "a.jpg", 4.0, before=seen))
    with pytest.raises(OvertakenError, match="another page"):
        found.apply(MarkChange(kind="mark", point="P 1", photo="a.jpg", before=seen, after=None))
    assert found.marks.points[0].marks["a.jpg"].col == 9.0
    # In another photograph nothing was overtaken.
    found.apply(marked("P 1", "b.jpg", 4.0, before=seen))


def test_a_change_that_is_sent_twice_is_made_once(tmp_path):
    found = filled(tmp_path)
    change = marked("P 1", "a.jpg", 9.0, before=Mark(col=5.0, row=7.25))
    found.apply(change)
    revision = found.revision
    found.apply(change)
    assert found.revision == revision


def test_renaming_keeps_marks_and_distances(tmp_path):
    found = filled(tmp_path)
    found.apply(PointChange(kind="point", before=TIE, after=TIE.model_copy(update={"name": "bar"})))
    assert found.marks.points[1].name == "bar" and len(found.marks.points[1].marks) == 2
    assert found.marks.distances[0].second == "bar"
    found.apply(PointChange(kind="point", before=TIE.model_copy(update={"name": "bar"}), after=None))
    assert found.marks.distances == ()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (marked("P 1", "c.jpg", 5.0), "no photograph c.jpg"),
        (marked("T", "a.jpg", 400.0, before=Mark(col=6.0, row=7.25)), "outside of a.jpg, which has 100 x 80 px"),
        (PointChange(kind="point", before=None, after=TIE.model_copy(update={"xyz": (1.0, 2.0, 3.0)})), "already"),
        (PointChange(kind="point", before=TIE, after=GROUND.model_copy(update={"role": "check"})), "already"),
        (
            DistanceChange(kind="distance", before=None, after=Distance(first="T", second="T", length=1.0, sigma=0.1)),
            "two different",
        ),
    ],
)
def test_what_cannot_be_is_one_sentence(tmp_path, change, sentence):
    found = filled(tmp_path)
    before = found.marks
    with pytest.raises(StoreError, match=sentence):
        found.apply(change)
    assert found.marks == before == ledger(tmp_path).marks


@pytest.mark.parametrize("name", ["", " ", "a,b", 'a"b', "a\nb", "x" * 81])
def test_names_that_no_file_could_hold_are_refused(name):
    with pytest.raises(ValueError):
        CHANGES.validate_python({"kind": "point", "before": None, "after": {"name": name}})


def test_a_damaged_ledger_is_told_and_left_alone(tmp_path):
    (tmp_path / LEDGER).write_text('{"points": [{"na')
    with pytest.raises(StoreError, match="restore it from a copy"):
        ledger(tmp_path)
    assert (tmp_path / LEDGER).read_text() == '{"points": [{"na'


KILLED = """
import sys, pathlib
sys.path[:0] = [{tests!r}]
from test_mark_ledger import ledger, marked
from orthomill.schemas.marks import Mark
found = ledger(pathlib.Path(sys.argv[1]))
before = None if "a.jpg" not in found.marks.points[0].marks else found.marks.points[0].marks["a.jpg"]
for n in range(100000):
    col = float(n % 90)
    found.apply(marked("P 1", "a.jpg", col, before=before))
    before = Mark(col=col, row=7.25)
    print(n, flush=True)
"""


def test_a_kill_at_any_moment_loses_no_answered_mark(tmp_path):
    ledger(tmp_path).apply(PointChange(kind="point", before=None, after=GROUND))
    program = KILLED.format(tests=os.path.dirname(__file__))
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "0\n"
    time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    told = [int(line) for line in process.stdout.read().split()]
    process.wait()
    last = told[-1] if told else 0
    kept = json.loads((tmp_path / LEDGER).read_text())["points"][0]["marks"]["a.jpg"]["col"]
    # The last answered mark, or the one after it, whose answer was lost.
    assert kept in (float(last % 90), float((last + 1) % 90))
    assert ledger(tmp_path).marks.points[0].marks["a.jpg"].col == kept
