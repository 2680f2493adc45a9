"""A run with a profile of acceptance that is not held against it says why."""

from types import SimpleNamespace

from orthomill.pipeline.cli.lookups.unjudged_run import unjudged

STAGES = tuple(SimpleNamespace(kind=kind) for kind in ("orientation", "texture", "accuracy"))


def loaded(folder):
    project = SimpleNamespace(project="site", acceptance=SimpleNamespace(kind="adv_truedop"))
    return SimpleNamespace(project=project, stages=STAGES, run_folder=folder)


def test_a_run_that_made_everything_is_judged(tmp_path):
    assert unjudged(loaded(tmp_path), None) == unjudged(loaded(tmp_path), "accuracy") == ""


def test_the_stages_that_are_still_to_come_are_named(tmp_path):
    said = unjudged(loaded(tmp_path), "orientation")
    assert said.startswith("Acceptance by adv_truedop was not judged: the run ended with orientation")
    assert "(texture, accuracy); run all of it: orthomill run site." in said


def test_products_in_an_object_store_are_not_fetched_unasked(tmp_path):
    (tmp_path / "store.txt").write_text("s3://bucket/site\n")
    said = unjudged(loaded(tmp_path), None)
    assert "are kept in s3://bucket/site" in said and said.endswith("orthomill accept site.")
