"""Self-calibrating bundles on the geometry of the three published applications (A-18, A-19 of sources/blending.md)."""

import numpy as np
import pytest

from benchmarks.orientation.published_blocks import adjusted, church, entrance, interior_sigmas, site, texture_shift

PUBLISHED = np.array([1.36, 1.03, 0.87, 0.04e-8 * 2573.94**2, 0.19e-15 * 2573.94**4])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_seven_photographs_and_eighteen_points_calibrate_the_camera(seed, record_property):
    result, truth = adjusted(church(), seed)
    sigma = interior_sigmas(result)
    assert (np.abs(result.state.interior[0, :5] - truth.interior[0, :5]) < 3.5 * sigma).all()
    off = np.abs(result.state.interior[0, 0] - truth.interior[0, 0])
    record_property("found", f"c off by {off:.2f} px, formally {sigma[0]:.2f}; sigma0 {result.sigma0_px:.3f} px of 0.28")
    assert 1.0 < sigma[0] < 2.0, "the published 1.36 px"
    assert ((sigma > 0.4 * PUBLISHED) & (sigma < 1.5 * PUBLISHED)).all()
    assert result.sigma0_px == pytest.approx(0.28, rel=0.1)


def test_control_from_scans_and_a_low_wall_weaken_the_camera_but_not_the_texture(record_property):
    (weak, truth), block = adjusted(site(3), 4), site(3)
    strong, middle = (interior_sigmas(adjusted(site(part), 4)[0]) for part in (1, 2))
    sigma = interior_sigmas(weak)
    assert (sigma[:3] > 2.0 * strong[:3]).all() and (sigma[:3] > 2.0 * middle[:3]).all()
    assert 10.0 < sigma[0] < 40.0, "the published 17.4 px"
    assert (np.abs(weak.state.interior[0, :5] - truth.interior[0, :5]) < 3.5 * sigma).all()
    # The camera is off by tens of pixels, and yet photographs meet within their noise.
    shift = texture_shift(weak, truth, block)
    record_property("found", f"sigma of c {sigma[0]:.1f} px ({strong[0]:.1f} with relief); photographs meet within {shift:.2f} px")
    assert shift < 1.0


def test_targets_of_scans_serve_as_control():
    result, truth = adjusted(entrance(), 5)
    sigma = interior_sigmas(result)
    assert (np.abs(result.state.interior[0, :5] - truth.interior[0, :5]) < 3.5 * sigma).all()
    assert result.sigma0_px == pytest.approx(0.25, rel=0.1) and texture_shift(result, truth, entrance()) < 0.6
