"""The records of jobs: kept whole, read back as they were, and judged in a fixed order."""

import os
import resource
import shutil
import signal
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orthomill.pipeline.records.record_files import StageFiles
from orthomill.pipeline.records.record_lines import line_of
from orthomill.pipeline.records.records import Fingerprint, Record, Records, reason_to_run
from orthomill.pipeline.storage.file_names import file_name
from orthomill.pipeline.storage.sealed_json import seal
from orthomill.schemas.errors import StoreError

PRINT = Fingerprint(settings="s", code="c", inputs="i")


def record(**more) -> Record:
    fields = {
        "stage": "texture",
        "item": "tile",
        "row": 2,
        "col": 3,
        "status": "done",
        "fingerprint": PRINT,
        "reason": "not done yet",
    }
    return Record(**(fields | more))


@pytest.fixture
def records(tmp_path):
    return Records(tmp_path)


def test_a_record_comes_back_as_it_was(records):
    kept = record(births={"texture/ortho": "b"}, started=12.5, seconds=0.25, worker="77", peak_bytes=2**30, run="r")
    records.put(kept)
    assert records.get(kept.key) == kept
    (log,) = (records.depot.path / "jobs").joinpath("texture").iterdir()
    assert log.name.startswith("00000001-") and log.suffix == ".log"


def test_a_job_without_a_record_has_none(records):
    assert records.get(("texture", "tile", 0, 0)) is None
    assert records.of_stage("texture") == ()
    records.remove(("texture", "tile", 0, 0))


def test_a_removed_record_is_gone(records):
    records.put(record())
    later = Records(records.depot)
    later.remove(record().key)
    assert later.get(record().key) is None and records.afresh(record().key) is None
    later.fold()
    assert Records(records.depot).get(record().key) is None


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"stage": "texture"}', b"\xff\xfe", b"[1]", b"null", b'{"item": []}'])
def test_a_damaged_record_of_an_earlier_version_counts_as_none(records, content):
    for row in (2, 9):
        of_one_job(records, record(row=row)).write_text(record(row=row).model_dump_json())
    of_one_job(records, record()).write_bytes(content)
    assert records.get(record().key) is None
    assert [kept.row for kept in records.of_stage("texture")] == [9]


def of_one_job(records, kept: Record):
    """The file of a record as earlier versions wrote it."""
    place = (records.depot.path / "jobs") / kept.stage / f"{file_name(kept.item)}.{kept.row}.{kept.col}.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    return place


def test_the_records_of_a_stage_are_its_own(records):
    for stage, row in (("texture", 1), ("texture", 0), ("photos", 5)):
        records.put(record(stage=stage, row=row))
    assert [kept.row for kept in records.of_stage("texture")] == [0, 1]
    assert [kept.row for kept in records.of_stage("photos")] == [5]


@pytest.mark.parametrize(
    "items", [("α", "β", "γ"), ("照片一", "照片二", "相片三"), ("p(1)", "p[1]", "p 1 ", "p~1"), ("x" * 250 + "a", "x" * 250 + "b")]
)
def test_photographs_of_any_names_have_records_of_their_own(records, items):
    for row, item in enumerate(items):
        records.put(record(stage="photos", item=item, row=0, col=0, seconds=float(row)))
    assert [records.get(("photos", item, 0, 0)).seconds for item in items] == list(map(float, range(len(items))))
    assert len(records.of_stage("photos")) == len(items)


def test_a_record_under_the_name_of_another_job_counts_as_none(records):
    of_one_job(records, record(row=7)).write_text(record().model_dump_json())
    assert records.get(record(row=7).key) is None and records.get(record().key) is None


def test_records_of_another_stage_count_as_none(records):
    records.put(record())
    (records.depot.path / "jobs").joinpath("texture").rename((records.depot.path / "jobs") / "photos")
    assert Records(records.depot).of_stage("photos") == ()


OTHER = {name: replace(PRINT, **{name: "x"}) for name in ("settings", "code", "inputs")}


@pytest.mark.parametrize(
    ("kept", "wanted", "births", "defect", "reason"),
    [
        (None, PRINT, {}, None, "not done yet"),
        (record(status="failed"), PRINT, {}, None, "failed before"),
        (record(), OTHER["settings"], {}, None, "settings changed"),
        (record(), OTHER["code"], {}, None, "code changed"),
        (record(), OTHER["inputs"], {}, None, "inputs changed"),
        (record(births={"a": "1"}), PRINT, {"a": "2"}, None, "result is missing"),
        (record(births={"a": "1"}), PRINT, {}, None, "result is missing"),
        (record(), PRINT, {}, "missing", "result is missing"),
        (record(births={"a": "1"}), PRINT, {"a": "1"}, None, None),
    ],
)
def test_the_reason_to_run(kept, wanted, births, defect, reason):
    assert reason_to_run(kept, wanted, births, defect) == reason


def test_a_changed_setting_is_named_before_changed_code_and_inputs():
    """The user changed the setting; that everything after it changes too is only a consequence."""
    changed = Fingerprint(settings="x", code="x", inputs="x")
    assert reason_to_run(record(), changed, {}, "missing") == "settings changed"
    assert reason_to_run(record(), replace(OTHER["inputs"], code="x"), {}, "missing") == "code changed"


def test_every_part_of_a_fingerprint_counts_in_its_text():
    texts = {PRINT.text, *(other.text for other in OTHER.values())}
    assert len(texts) == 4


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_flipped_bit_changes_what_a_record_says(records, data):
    kept = [record(row=row, files={"tables/a.json": (3, 4, 5)}, seconds=1.25) for row in (1, 2, 3)]
    shutil.rmtree((records.depot.path / "jobs"), ignore_errors=True)
    for one in kept:
        Records((records.depot.path / "jobs").parent, 1).put(one)
    (path,) = (records.depot.path / "jobs").joinpath("texture").iterdir()
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(content)
    found, damaged = Records(records.depot).sort_out()
    assert set(map(str, found)) <= set(map(str, kept)) and len(found) >= 1, "the others are as they were"
    assert len(found) == 3 or damaged == (f"jobs/texture/{path.name}",) or content[-1:] != b"\n"


def test_records_of_an_earlier_version_count_with_a_checksum_and_without(records):
    of_one_job(records, record()).write_text(record().model_dump_json(exclude={"files"}))
    of_one_job(records, record(row=4)).write_bytes(seal(record(row=4, seconds=2.5).model_dump_json().encode()))
    assert records.get(record().key) == record() and records.get(record(row=4).key) == record(row=4, seconds=2.5)
    records.put(record(row=4, status="failed"))
    records.fold()
    assert [path.name for path in (records.depot.path / "jobs").joinpath("texture").iterdir()] == ["00000001.done"]
    assert Records(records.depot).of_stage("texture") == (record(), record(row=4, status="failed"))


def test_the_end_of_a_log_that_a_killed_process_left_is_no_record(records):
    records.put(record())
    records.put(record(row=9, status="failed"))
    (log,) = (records.depot.path / "jobs").joinpath("texture").iterdir()
    whole = log.read_bytes()
    for cut in range(whole.index(b"\n") + 1, len(whole)):
        log.write_bytes(whole[:cut])
        found, damaged = Records(records.depot).sort_out()
        assert found == (record(),) and damaged == ()


def test_what_another_process_has_done_is_seen_when_it_is_asked_for_afresh(records):
    assert records.get(record().key) is None
    other = Records((records.depot.path / "jobs").parent, wave=1)
    other.remove(record().key)
    other.put(record(worker="other"))
    assert records.get(record().key) is None and records.afresh(record().key).worker == "other"


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_within_a_run_what_is_done_counts_and_otherwise_the_later_run(records, order):
    """Two workers that do the same job, one of them killed, may be read in any order."""
    lines = [line_of(("tile", 2, 3), status, 0.0, text) for status, text in (("removed", b""), ("failed", b"{}"), ("done", b"{2}"))]
    stage = StageFiles(records.depot, "jobs/texture")
    folder = records.depot.path / stage.folder
    folder.mkdir(parents=True)
    for number in order:
        (folder / f"00000002-{number}-a.log").write_bytes(lines[number])
    stage.refresh()
    assert stage.lines["tile", 2, 3].text == b"{2}"
    (folder / "00000003-0-a.log").write_bytes(lines[0])
    stage.refresh()
    assert stage.lines["tile", 2, 3].text == b""


def test_who_looks_while_the_records_are_folded_misses_none(records, monkeypatch):
    for row in (1, 2):
        records.put(record(row=row))
    real, looked = StageFiles._take, Records(records.depot)

    def folded_meanwhile(stage, path):
        monkeypatch.setattr(StageFiles, "_take", real)
        records.fold()
        return real(stage, path)

    monkeypatch.setattr(StageFiles, "_take", folded_meanwhile)
    assert [kept.row for kept in looked.of_stage("texture")] == [1, 2]


@pytest.mark.parametrize("killed", range(6))
def test_folding_that_is_killed_anywhere_loses_nothing(records, killed, monkeypatch):
    for wave in (1, 2, 3):
        for row in range(wave, 5):
            Records((records.depot.path / "jobs").parent, wave).put(record(row=row, seconds=float(wave)))
    Records((records.depot.path / "jobs").parent, 3).remove(record(row=4).key)
    of_one_job(records, record(row=0)).write_text(record(row=0).model_dump_json())
    before = Records(records.depot).of_stage("texture")
    assert [kept.row for kept in before] == [0, 1, 2, 3, 4]
    calls = iter(range(99))

    def at_last(real):
        def call(*words, **more):
            if next(calls) == killed:
                raise KeyboardInterrupt
            return real(*words, **more)

        return call

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", at_last(Path.unlink))
        patch.setattr(os, "replace", at_last(os.replace))
        with suppress(KeyboardInterrupt):
            records.fold()
    assert Records(records.depot).of_stage("texture") == before
    Records(records.depot).fold()
    assert Records(records.depot).of_stage("texture") == before
    assert len(list((records.depot.path / "jobs").joinpath("texture").iterdir())) == 1


def test_records_that_find_no_room_on_the_disk_leave_no_half_line(records):
    records.put(record())
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    (log,) = (records.depot.path / "jobs").joinpath("texture").iterdir()
    whole = log.read_bytes()
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) + 10, limit[1]))
    try:
        with pytest.raises(StoreError, match="cannot be written: "):
            records.put(record(row=9))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert log.read_bytes() == whole
    records.put(record(row=9))
    assert len(records.of_stage("texture")) == 2
