"""The records of jobs: kept whole, read back as they were, and judged in a fixed order."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orthomill.pipeline.records.records import Fingerprint, Record, Records, reason_to_run

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
    assert records.folder.joinpath("texture", "tile.2.3.json").exists()


def test_a_job_without_a_record_has_none(records):
    assert records.get(("texture", "tile", 0, 0)) is None
    assert records.of_stage("texture") == ()
    records.remove(("texture", "tile", 0, 0))


def test_a_removed_record_is_gone(records):
    records.put(record())
    records.remove(record().key)
    assert records.get(record().key) is None


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"stage": "texture"}', b"\xff\xfe"])
def test_a_damaged_record_counts_as_none(records, content):
    records.put(record())
    records.put(record(row=9))
    records.path(record().key).write_bytes(content)
    assert records.get(record().key) is None
    assert [kept.row for kept in records.of_stage("texture")] == [9]


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
    records.put(record())
    records.path(record().key).rename(records.path(record(row=7).key))
    assert records.get(record(row=7).key) is None


OTHER = {name: PRINT.model_copy(update={name: "x"}) for name in ("settings", "code", "inputs")}


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
    assert reason_to_run(record(), OTHER["inputs"].model_copy(update={"code": "x"}), {}, "missing") == "code changed"


def test_every_part_of_a_fingerprint_counts_in_its_text():
    texts = {PRINT.text, *(other.text for other in OTHER.values())}
    assert len(texts) == 4


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_flipped_bit_changes_what_a_record_says(records, data):
    records.put(record(files={"tables/a.json": (3, 4, 5)}, seconds=1.25))
    path = records.path(record().key)
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(content)
    assert records.get(record().key) in (None, record(files={"tables/a.json": (3, 4, 5)}, seconds=1.25))


def test_a_record_of_an_earlier_version_without_a_checksum_still_counts(records):
    records.put(record())
    records.path(record().key).write_text(record().model_dump_json(exclude={"files"}))
    assert records.get(record().key) == record()
