"""The report on the orthoimage: figures from sums over tiles, classes of the pictures, and every warning with its fact."""

import pytest

from orthomill.schemas.surface import HeightSource
from orthomill.tasks.colouring.balance.photo_radiometry import PhotoRadiometry, Radiometry
from orthomill.tasks.colouring.blending.colour_sums import ColourSums
from orthomill.tasks.colouring.report.colour_words import COVERAGE_COLOURS, coverage_classes
from orthomill.tasks.texture.edges.drawn_edges import DrawnEdges
from orthomill.tasks.texture.mosaic import TileTexture
from orthomill.tasks.texture.report.texture_report import TextureFacts, texture_report

FACTS = TextureFacts(cell=0.5, dsm_cell=1.0, ground_pixel=0.48123, heights="densification/height")


COLOURS = ColourSums(
    seen=(100, 200, 300, 400),
    values=2500,
    rejected=100,
    difference_sum=1400.0,
    difference_count=700,
    shares={"a": 600.0, "b": 300.0},
)


def tile(**changes) -> TileTexture:
    """A tile; changes of its own fields and of those of its colours."""
    facts = {
        "pixels": 1000,
        "heights": (80, 860, 50, 10),
        "outside": 70,
        "hidden": 20,
        "missed": 10,
        "most": 4,
        "photo_seen": {"a": 900, "b": 700},
        "drawn": DrawnEdges(),
    }
    colours = {name: changes.pop(name) for name in ColourSums.model_fields if name in changes}
    return TileTexture(**{**facts, **changes}, colours=COLOURS.model_copy(update=colours))


def radiometry(**changes) -> Radiometry:
    facts = {
        "photos": (
            PhotoRadiometry(photo="a", gain=(1.1, 1.0, 0.9), v1=(-0.2,) * 3, v2=(0.05,) * 3, samples=40),
            PhotoRadiometry(photo="b"),
        ),
        "samples": 80,
        "points": 40,
        "difference_before": 12.3456,
        "difference_after": 2.5,
        "difference_median_after": 1.25,
    }
    return Radiometry(**{**facts, **changes})


def report(*tiles: TileTexture, balance: Radiometry | None = None):
    return texture_report(tiles or (tile(),), balance or radiometry(), (), FACTS)


def values(made) -> dict:
    return {figure.name: figure.value for figure in made.figures}


def test_figures_of_one_tile():
    assert values(report()) == {
        "cell": 0.5,
        "photo_ground_pixel": 0.4812,
        "pixels": 1000,
        "height_share": 92.0,
        "estimated_share": 1.0,
        "draped_share": 5.0,
        "seen_by_0": 10.0,
        "seen_by_1": 20.0,
        "seen_by_2": 30.0,
        "seen_by_3_or_more": 40.0,
        "outside_share": 7.0,
        "occluded_share": 2.0,
        "missed_share": 1.0,
        "rejected_share": 4.0,
        "seam_difference": 2.0,
        "balance_difference_before": 12.346,
        "balance_difference_after": 2.5,
        "balance_difference_median_after": 1.25,
        "balance_samples": 40,
    }


def test_shares_of_several_tiles_weight_by_pixels():
    """A tile of 1000 pixels and one of 3000 without any height: a quarter counts once, not half."""
    empty = tile(
        pixels=3000,
        seen=(3000, 0, 0, 0),
        heights=(3000, 0, 0, 0),
        outside=3000,
        hidden=0,
        missed=0,
        values=0,
        rejected=0,
        difference_sum=0.0,
        difference_count=0,
        photo_seen={},
        shares={},
    )
    found = values(report(tile(), empty))
    assert found["pixels"] == 4000 and found["height_share"] == 23.0 and found["seen_by_3_or_more"] == 10.0
    assert (found["outside_share"], found["occluded_share"], found["missed_share"]) == (76.75, 0.5, 0.25)
    assert found["seam_difference"] == 2.0 and found["rejected_share"] == 4.0


def test_the_grid_adds_the_contributions_of_all_tiles():
    (grid,) = report(tile(), tile(photo_seen={"b": 100}, shares={"b": 100.0})).grids
    first, second = grid.rows
    assert first[:3] == ("a", 900, 60.0) and second[:3] == ("b", 800, 40.0)
    assert first[3:6] == (1.1, 1.0, 0.9) and first[9:] == (-0.15, 40)
    assert len(first) == len(grid.columns) == 11


def test_the_chart_shows_pixels_by_number_of_photos():
    (chart,) = report(tile(), tile()).charts
    assert chart.series["pixels"] == (200.0, 400.0, 600.0, 800.0)


def test_a_good_orthoimage_gives_no_warning():
    assert report().warnings == ()


@pytest.mark.parametrize(
    ("changes", "words", "doubtful"),
    [
        ({"seen": (1000, 0, 0, 0), "heights": (1000, 0, 0, 0)}, "The orthoimage is empty", True),
        ({"hidden": 60}, "6.0 % of the orthoimage is hidden by objects in front from every photo", False),
        ({"rejected": 700}, "28 % of all colours were rejected", True),
        ({"photo_seen": {"a": 900}}, "No ground of the orthoimage is seen by: b.", False),
    ],
)
def test_weaknesses_of_the_image_are_reported(changes, words, doubtful):
    found = report(tile(**changes))
    assert any(words in text for text in found.warnings)
    assert any(words in text for text in found.doubts) == doubtful


@pytest.mark.parametrize(
    ("changes", "count"), [({"hidden": 50}, 0), ({"hidden": 51}, 1), ({"rejected": 625}, 0), ({"rejected": 626}, 1)]
)
def test_warnings_begin_beyond_their_limits(changes, count):
    assert len(report(tile(**changes)).warnings) == count


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"points": 0}, "were not adjusted to one brightness"), ({"difference_median_after": 14.6}, "still differ by 15 grey levels")],
)
def test_weaknesses_of_the_balance_are_reported(changes, words):
    (warning,) = report(balance=radiometry(**changes)).warnings
    assert words in warning


def test_a_single_photo_needs_no_balance():
    alone = radiometry(photos=(PhotoRadiometry(photo="a"),), points=0, difference_median_after=None)
    assert report(balance=alone).warnings == ()


@pytest.mark.parametrize("most", [0, 3, 7])
def test_coverage_has_a_class_for_every_count(most):
    classes = coverage_classes(most)
    assert [code for code, _, _ in classes] == list(range(max(most, 3) + 1))
    assert [colour for _, colour, _ in classes[:4]] == list(COVERAGE_COLOURS)
    assert {colour for _, colour, _ in classes[3:]} == {COVERAGE_COLOURS[3]}


def test_pictures_know_the_codes_of_their_rasters():
    pictures = {picture.title: picture for picture in report(tile(most=6)).pictures}
    assert len(pictures["Coverage"].classes) == len(pictures["Rejected colours"].classes) == 7
    assert [code for code, _, _ in pictures["Where heights come from"].classes] == list(HeightSource)


def test_without_blended_pixels_there_is_no_seam_difference():
    assert values(report(tile(difference_sum=0.0, difference_count=0)))["seam_difference"] is None


@pytest.mark.parametrize(
    ("changes", "level", "words"),
    [
        ({"hidden": 0, "missed": 0}, "good", "shows all of the ground"),
        ({"hidden": 20, "missed": 10}, "fair", "shows 96.8 %"),
        ({"outside": 1000, "hidden": 0, "missed": 0}, "poor", "empty"),
    ],
)
def test_the_verdict_is_the_share_of_the_photographed_ground_that_is_shown(changes, level, words):
    verdict = report(tile(**changes)).verdict
    assert verdict.level == level and verdict.weighs and words in verdict.sentence


def test_nearly_all_is_never_rounded_to_all():
    made = report(tile(pixels=1_000_000, outside=0, hidden=0, missed=1))
    assert "99.9 %" in made.verdict.sentence


def drawn(jagged: float, in_photos: float) -> DrawnEdges:
    return DrawnEdges(places=10, drawn=8, squares=100 * jagged**2, profiles=100, photo_squares=90 * in_photos**2, photo_profiles=90)


def test_edges_stand_beside_those_of_the_photographs():
    made = report(tile(drawn=drawn(0.5, 0.4)), tile(drawn=drawn(0.7, 0.4)), tile())
    found = values(made)
    assert (found["edges_drawn"], found["edges_jagged"], found["edges_jagged_in_photos"]) == (80.0, 0.608, 0.4)
    assert not any("frayed" in words for words in made.warnings)
    assert "edges_jagged" not in values(report())


@pytest.mark.parametrize(("jagged", "in_photos", "told"), [(1.6, 0.5, True), (1.6, 1.2, False), (0.9, 0.2, False)])
def test_edges_are_called_frayed_where_photographs_show_them_straight(jagged, in_photos, told):
    assert any("frayed" in words for words in report(tile(drawn=drawn(jagged, in_photos))).warnings) == told
