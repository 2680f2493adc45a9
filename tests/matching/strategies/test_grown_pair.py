"""Two photographs of which nothing is known: matched and related by growth, whatever they are turned by."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_plane import CAMERA, photograph, texture, true_partner, views
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.cli.lookups.grown_photographs import grown_lines, read_seeds
from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.inspections.inspection import GrownPair, GrownUnknown
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.grown_pair import GrowthRules, found_by_features, grown_pair, related
from orthomill.tasks.orientation.relative.relative_forms import dependent_form

LEFT, RIGHT, TURNED = 0, 1, 2
"""numbers of photographs; the second is turned by 23 degrees against the first"""


@pytest.fixture(scope="module")
def images():
    image = texture()
    return [photograph(view, image, seed)[..., 0] for seed, view in enumerate(views())]


def off(matches: np.ndarray, left: int, right: int) -> np.ndarray:
    """px between matches and the true places on the right."""
    return np.linalg.norm(matches[:, 2:] - true_partner(views()[left], views()[right], matches[:, :2]), axis=1)


def test_turned_photographs_are_matched_and_related_without_any_start(images):
    c = float(CAMERA.c)
    pair = grown_pair(images[LEFT], images[RIGHT], None, GrowthRules(12, 21, (c, c)))
    assert len(pair.matches) > 300 and np.percentile(off(pair.matches, LEFT, RIGHT), 95) < 0.3
    assert pair.kept > 0.8 * pair.related and pair.sigma0_px < 0.5
    one, other = views()[LEFT], views()[RIGHT]
    true = dependent_form(one.rotation @ (other.centre - one.centre), other.rotation @ one.rotation.T, c, c).unknowns
    assert not pair.turned
    # The lens is not known, and a plane hardly tells a tilt from a shift.
    found = np.array([np.radians(u.value) if u.unit else u.value for u in pair.unknowns])
    sigma = np.array([np.radians(u.sigma) if u.unit else u.sigma for u in pair.unknowns])
    assert (np.abs(found - true) < 3.0 * sigma).all() and np.degrees(sigma[4]) < 1.0


def test_standard_errors_hold_what_a_camera_without_calibration_is_wrong_by():
    rng = np.random.default_rng(4)
    c, base, turn = 1500.0, np.array([1.0, 0.05, -0.03]), rotation_matrix(0.02, -0.03, 0.05)
    ground = np.column_stack(
        [rng.uniform(-0.5, 1.5, (400, 1)), rng.uniform(-0.8, 0.8, (400, 1)), rng.uniform(-3.3, -2.7, (400, 1))]
    )
    seen = [-c * rays[:, :2] / rays[:, 2:] for rays in (ground, (ground - base) @ turn.T)]
    # The principal point lies 20 px off, and the lens displaces by 8 px at the end of the frame of 2000 px.
    moved = [p * (1.0 + 0.008 * (np.linalg.norm(p, axis=1, keepdims=True) / 1000.0) ** 2) + [16.0, -12.0] for p in seen]
    noisy = np.column_stack([p * [1.0, -1.0] + 999.5 for p in moved]) + rng.normal(0.0, 0.05, (400, 4))
    found = related(GrownPair(1, 400, noisy, np.full(400, 0.05)), (2000, 2000), (2000, 2000), (c, c)).unknowns
    errors = [
        (np.radians(u.value) if u.unit else u.value) - t
        for u, t in zip(found, dependent_form(base, turn, c, c).unknowns, strict=True)
    ]
    stated = [np.radians(u.sigma) if u.unit else u.sigma for u in found]
    assert (np.abs(errors) < 2.0 * np.array(stated)).all() and max(np.abs(errors) / stated) > 0.5


def test_an_orientation_that_few_matches_agree_on_is_doubted():
    unknowns = (GrownUnknown("kappa", "degrees", 1.0, 0.1),)
    pair = GrownPair(9, 99, np.zeros((48, 4)), np.full(48, 0.04), 48, 23, 0.26, unknowns)
    assert "Only 23 of 48 matches agree" in " ".join(grown_lines(pair))
    assert "Only" not in " ".join(grown_lines(replace(pair, kept=40)))


def test_seeds_of_whole_pixels_are_read_as_four_numbers(tmp_path):
    (tmp_path / "seeds.csv").write_text("300,300,140,300\n")
    np.testing.assert_array_equal(read_seeds(tmp_path / "seeds.csv"), [[300, 300, 140, 300]])


def test_a_list_of_seeds_takes_the_place_of_features(images, tmp_path):
    start = found_by_features(images[LEFT], images[RIGHT])
    (tmp_path / "seeds.csv").write_text(
        "left col;left row;right col;right row\n"
        + "".join(
            ";".join(f"{v:.1f}" for v in (*a, *b)) + "\n" for a, b in zip(start.points[:40:5], start.right[:40:5], strict=True)
        )
    )
    seeds = read_seeds(tmp_path / "seeds.csv")
    assert len(seeds) == 8
    # Without a turn the first windows differ by 23 degrees: only photographs that are not turned grow from places alone.
    whole = np.ascontiguousarray(images[LEFT])
    pair = grown_pair(whole, np.roll(whole, 7, axis=1), np.array([[200.0, 150.0, 207.0, 150.0]]), GrowthRules(16))
    assert pair.seeds == 1 and len(pair.matches) > 50
    np.testing.assert_allclose(pair.matches[:, 2] - pair.matches[:, 0], 7.0, atol=0.05)
    assert not pair.unknowns, "without a camera there is no orientation"


def test_what_does_not_grow_is_told(images, tmp_path):
    blank = np.full_like(images[LEFT], 90)
    with pytest.raises(PhotoError, match="show no common points"):
        grown_pair(blank, blank, None, GrowthRules())
    with pytest.raises(PhotoError, match="Nothing grew from 1 seeds"):
        grown_pair(images[LEFT], images[RIGHT], np.array([[50.0, 50.0, 400.0, 10.0]]), GrowthRules())
    (tmp_path / "none.csv").write_text("nothing here\n")
    with pytest.raises(WorkflowError, match="holds no seeds"):
        read_seeds(tmp_path / "none.csv")


def test_the_command_matches_two_files_and_writes_the_matches(images, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, image in (("a.png", images[LEFT]), ("b.png", images[RIGHT])):
        cv2.imwrite(name, image)
    said = CliRunner().invoke(app, ["grow", "a.png", "b.png", "--step", "24", "--c", str(CAMERA.c), "--output", "m.csv"])
    assert said.exit_code == 0 and "Relative orientation from" in said.output and "kappa" in said.output
    rows = np.loadtxt(Path("m.csv"), delimiter=",", skiprows=1)
    assert np.percentile(off(rows[:, :4], LEFT, RIGHT), 90) < 0.4 and (rows[:, 4] > 0).all()
    for words, says in (
        (["grow", "a.png", "no.png"], "does not exist"),
        (["grow", "a.png", "b.png", "--window", "20"], "no middle"),
    ):
        refused = CliRunner().invoke(app, words)
        assert refused.exit_code != 0 and says in " ".join(refused.output.split())
