"""Two photographs of which nothing is known: matched and related by growth, whatever they are turned by."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_plane import CAMERA, photograph, texture, true_partner, views
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.cli.lookups.grown_photographs import read_seeds
from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.grown_pair import GrowthRules, found_by_features, grown_pair

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
    base = one.rotation @ (other.centre - one.centre)
    turn = other.rotation @ one.rotation.T
    found = {unknown.name: unknown for unknown in pair.unknowns}
    angles = np.radians([found[name].value for name in ("omega", "phi", "kappa")])
    assert not pair.turned
    # The lens is not known, and a plane hardly tells a tilt from a shift.
    np.testing.assert_allclose(rotation_matrix(*angles), turn, atol=0.04)
    assert abs(found["b_y / b_x"].value - base[1] / base[0]) < max(4 * found["b_y / b_x"].sigma, 0.04)


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
