"""Every setting of the check does what its sentence says: on rays, on nodes, on shifts and on the corrected surface."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.dsm_check.comparison_settings import NodeMatching, ShiftSearch
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, share_applied
from orthomill.tasks.dsm_check.height_correction import Centres, PlanCorrection, RayCorrection, correct, nadir_angle
from orthomill.tasks.dsm_check.nodes import CORRELATION, DH, EAST, OUTCOME, SIGMA, NodeTile, check_nodes, node_offset
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.dsm_check.tile import CorrectionRule
from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, LeastSquaresMatching, Square
from orthomill.tasks.matching.windows.window_settings import EntropyWindow, FoerstnerWindow, StatisticalWindow

CAMERA = Camera(name="c", width=1000, height=1000, c=800.0)
GRID = MapGrid(west=0.0, north=160.0, cell=1.0, rows=160, cols=160)
WHOLE = Window(0, 0, 160, 160)
BASE, HEIGHT = 120.0, 200.0


def photo(name: str, x: float, y: float = 80.0) -> ExteriorOrientation:
    return ExteriorOrientation(photo=name, centre=(x, y, HEIGHT), omega_phi_kappa=(0.0, 0.0, 0.0))


TILE = NodeTile(photo("l", 20.0), photo("r", 20.0 + BASE), GRID, WHOLE, WHOLE, 1, 8)


def picture(seed: int = 1) -> np.ndarray:
    values = gaussian_filter(np.random.default_rng(seed).standard_normal(WHOLE.shape), 1.5)
    return np.clip(np.rint(120 + 40 * values / values.std()), 1, 255).astype(np.uint8)


def moved(image: np.ndarray, dcol: float, drow: float = 0.0) -> np.ndarray:
    return np.clip(np.rint(shift(image.astype(float), (drow, dcol), order=3, mode="nearest")), 1, 255).astype(np.uint8)


FLAT = np.zeros(WHOLE.shape, np.float32)


def checked(right: np.ndarray, heights: np.ndarray = FLAT, correction=None, **settings_) -> np.ndarray:
    """Nodes (rows, cols, bands) of flat ground at 0 m; the right orthoimage as given."""
    return check_nodes(TILE, NodeMatching(**settings_), correction or RayCorrection(), picture(), right, heights)


def found(nodes: np.ndarray) -> np.ndarray:
    return nodes[..., OUTCOME] == Outcome.CONVERGED


@pytest.mark.parametrize("pixels", [-3.0, -1.0, 2.0, 4.0])
def test_a_shift_along_the_base_is_a_height(pixels):
    """Similar triangles: a shift of d along the base is a height of H d / (d - B), rays of either photograph crossing there."""
    nodes = checked(moved(picture(), pixels))
    expected = HEIGHT * pixels / (pixels - BASE)
    assert found(nodes).mean() > 0.4
    assert np.median(nodes[found(nodes), DH]) == pytest.approx(expected, abs=0.06)


def test_equal_orthoimages_ask_for_no_correction():
    nodes = checked(picture())
    assert found(nodes).mean() > 0.5 and np.abs(nodes[found(nodes)][:, DH]).max() < 0.01
    assert np.abs(nodes[found(nodes)][:, EAST]).max() < 0.01 and nodes[found(nodes)][:, CORRELATION].min() > 0.99


def test_the_corrected_point_lies_beside_its_node():
    """The point is seen from the left through the node, so it lies between the node and the left nadir when it is above it."""
    nodes = checked(moved(picture(), -4.0))
    good = np.argwhere(found(nodes))
    heights = nodes[found(nodes), DH]
    col = good[:, 1] * 8 + node_offset(8, 1)
    x = col + 0.5
    assert nodes[found(nodes), EAST] == pytest.approx((20.0 - x) * heights / HEIGHT, abs=0.1)


@pytest.mark.parametrize(("across", "accepted"), [(0.5, False), (2.5, True)])
def test_across_is_the_greatest_shift_across_the_base(across, accepted):
    nodes = checked(moved(picture(), 0.0, 1.0), search=ShiftSearch(across=across), correction=RayCorrection(parallax=50.0))
    assert found(nodes).any() == accepted
    assert (nodes[..., OUTCOME] == Outcome.INCONSISTENT).any() != accepted


@pytest.mark.parametrize(("parallax", "accepted"), [(0.2, False), (3.0, True)])
def test_the_y_parallax_of_the_rays_is_limited(parallax, accepted):
    nodes = checked(moved(picture(), 0.0, 1.0), correction=RayCorrection(parallax=parallax))
    assert found(nodes).any() == accepted


def test_least_sigma_is_the_floor_of_the_standard_errors():
    """sigma_dh = depth / base * sigma_shift on flat ground; the floor rules where the images are equal."""
    small, large = (checked(picture(), least_sigma=sigma) for sigma in (0.1, 0.4))
    both = found(small) & found(large)
    assert np.median(small[both, SIGMA]) == pytest.approx(0.1 * HEIGHT / BASE, rel=0.02)
    assert np.median(large[both, SIGMA]) == pytest.approx(0.4 * HEIGHT / BASE, rel=0.02)


def test_slopes_of_the_model_make_corrections_uncertain():
    """A step of 3 m at a node: an error of position of a quarter of a cell is worth 0.75 m of height and more."""
    steep = FLAT.copy()
    steep[:, 84:] = 3.0
    sigma = checked(picture(), heights=steep)[..., SIGMA]
    assert np.nanmax(sigma[:, 10]) > 3 * np.nanmedian(sigma)


def test_least_squares_settings_reach_the_matching():
    noisy = np.clip(picture() + np.random.default_rng(5).normal(0, 50, WHOLE.shape), 1, 255).astype(np.uint8)
    lenient, strict = (
        checked(noisy, least_squares=LeastSquaresMatching(window=11, max_shift=3.0, min_correlation=r)) for r in (0.2, 0.99)
    )
    assert found(lenient).mean() > 0.3 and found(strict).mean() < 0.02
    assert (strict[..., OUTCOME] == Outcome.LOW_CORRELATION).mean() > 0.3


@pytest.mark.parametrize(
    "window",
    [StatisticalWindow(largest=21), EntropyWindow(largest=21), FoerstnerWindow(largest=21)],
    ids=lambda window: window.kind,
)
@pytest.mark.parametrize("shape", [Square(), Ellipse()], ids=lambda shape: shape.kind)
def test_windows_chosen_node_by_node_find_the_same_shift(window, shape):
    matching = LeastSquaresMatching(window=window, shape=shape, max_shift=3.0, min_correlation=0.7)
    nodes = checked(moved(picture(), 2.0), least_squares=matching)
    assert found(nodes).mean() > 0.25
    assert np.median(nodes[found(nodes), DH]) == pytest.approx(HEIGHT * 2.0 / (2.0 - BASE), abs=0.06)
    assert not np.array_equal(nodes, checked(moved(picture(), 2.0)), equal_nan=True)


@pytest.mark.parametrize(("hidden", "occluded"), [(1.5, True), (60.0, False)])
def test_hidden_is_how_far_the_model_must_rise_above_the_ray(hidden, occluded):
    wall = FLAT.copy()
    wall[:, 100:102] = 30.0
    nodes = checked(picture(), heights=wall, hidden=hidden)
    assert (nodes[..., OUTCOME] == Outcome.OCCLUDED).any() == occluded


def test_the_shadow_of_a_wall_is_as_long_as_the_ray_says():
    """Behind a wall of h at distance d from the nadir ground is hidden for h d / (H - h), from the left photograph."""
    wall, tall = FLAT.copy(), 20.0
    wall[:, 100:102] = tall
    occluded = checked(picture(), heights=wall, hidden=0.5)[..., OUTCOME] == Outcome.OCCLUDED
    cols = np.nonzero(occluded[10])[0] * 8 + 4
    behind = cols[cols > 101]
    length = tall * (101.5 - 20.0) / (HEIGHT - tall)
    assert 101 < behind.min() < 101 + length and 101 + length - 9 < behind.max() <= 101 + length + 1


def test_nodes_in_gaps_of_the_model_are_outside():
    gap = FLAT.copy()
    gap[40:80, 40:80] = np.nan
    nodes = checked(picture(), heights=gap)[..., OUTCOME]
    assert (nodes[5:10, 5:10] == Outcome.OUTSIDE).all() and (nodes[2:-2, 2:-2] == Outcome.OUTSIDE).sum() == 25


CENTRES = Centres(np.array([0.0, 0.0, 1000.0]), np.array([600.0, 0.0, 1000.0]))


def plan_accepts(x: float, y: float, **settings_) -> bool:
    """Whether the plan construction accepts a point of true ground at 0 m."""
    at = np.array([[x, y, 0.0]])
    return bool(correct(at, at, CENTRES, PlanCorrection(**settings_), 1.0).accepted[0])


def test_angle_low_refuses_points_far_behind_the_base():
    angle = nadir_angle(np.array([[300.0, 2000.0]]), CENTRES)[0]
    assert angle == pytest.approx(2 * np.degrees(np.arctan(300 / 2000)))
    assert plan_accepts(300.0, 2000.0, angle_low=angle - 1) and not plan_accepts(300.0, 2000.0, angle_low=angle + 1)


def test_angle_high_refuses_points_between_the_nadirs():
    angle = nadir_angle(np.array([[300.0, 50.0]]), CENTRES)[0]
    assert angle > 150
    assert plan_accepts(300.0, 50.0, angle_high=angle + 1) and not plan_accepts(300.0, 50.0, angle_high=angle - 1)


def test_nadir_refuses_points_below_a_photograph():
    """40 m from the nadir at a depth of 1000 m is a share of 0.04."""
    assert plan_accepts(0.0, 40.0, nadir=0.035) and not plan_accepts(0.0, 40.0, nadir=0.045)


@pytest.mark.parametrize("significance", [1.0, 2.0, 5.0])
def test_significance_is_where_the_share_is_a_half(significance):
    ratio = np.array([[0.0, significance - 1.0, significance, significance + 1.0, 40.0]], np.float32)
    share = share_applied(CorrectionMap(ratio * 0.2, np.full_like(ratio, 0.2)), "significant", significance)
    assert share[0] == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0], abs=1e-5)


def test_settings_of_the_stage_reach_the_rule_of_a_tile():
    stage = DsmCheckStage(significance=4.5, apply="all", step=8, radius=2.0)
    assert stage.significance == 4.5
    rule = CorrectionRule(stage.apply, stage.significance, None, 8, 1.0)
    assert (rule.apply, rule.significance) == ("all", 4.5)


@pytest.mark.parametrize(("step", "factor", "offset"), [(4, 1, 2.0), (4, 2, 1.75), (2, 1, 1.0), (8, 2, 3.75)])
def test_nodes_lie_on_pixel_centres(step, factor, offset):
    """In a square of `step` cells, counted from the centre of its first cell."""
    assert node_offset(step, factor) == offset
    pixel = (offset + 0.5) * factor - 0.5
    assert pixel == int(pixel)


def test_the_halo_grows_with_search_and_window():
    plain = NodeMatching()
    wider = NodeMatching(search=ShiftSearch(reach=20))
    assert plain.halo % 2 == 0 and wider.halo == plain.halo + 20
    bigger = NodeMatching(least_squares=LeastSquaresMatching(window=31, max_shift=3.0))
    assert bigger.halo > plain.halo
