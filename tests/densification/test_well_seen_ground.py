"""What of the ground is background: photographs that look along it, photographs that look down, and its outline."""

import numpy as np
import pytest

from orthomill.schemas.camera import Camera
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.well_seen_ground import COARSEST, _outlines, _Squares, _without_scraps, well_seen_ground

CAMERA = Camera(name="one", width=1000, height=800, c=1000.0, x0=0.0, y0=0.0)
HEIGHT = 10.0


def block(*poses: tuple[tuple[float, float], float]) -> Block:
    """Photographs at places (x, y), 10 m above the ground, that look to the north, so many degrees off the nadir."""
    photos = tuple(
        ExteriorOrientation(photo=str(i), centre=(x, y, HEIGHT), omega_phi_kappa=(tilt, 0.0, 0.0), sigma=(0.1,) * 6)
        for i, ((x, y), tilt) in enumerate(poses)
    )
    return Block(
        crs="EPSG:32634",
        cameras={"one": CAMERA},
        of_photo={photo.photo: "one" for photo in photos},
        photos=photos,
        datum="free",
        sigma0_px=0.3,
        redundancy=100,
        iterations=3,
        ground_low=0.0,
        ground_high=0.0,
    )


def test_photographs_that_look_down_leave_nothing_out():
    flight = block(*(((float(x), 0.0), tilt) for x, tilt in ((0, -4.0), (3, 5.0), (6, 0.0))))
    assert well_seen_ground(flight, (-20.0, -20.0, 30.0, 20.0), 0.0, HEIGHT / CAMERA.c) == WantedArea()


def test_a_lens_whose_distortion_folds_back_shows_no_ground_beside_its_photograph():
    """Beyond its field Brown's polynomial comes back into the frame: it would be background of a flight that looks down."""
    bent = CAMERA.changed(k1=-0.27)
    down = block(*(((float(x), 0.0), 0.0) for x in (0, 3, 6)))
    flight = down.model_copy(update={"cameras": {"one": bent}})
    assert well_seen_ground(flight, (-30.0, -30.0, 36.0, 30.0), 0.0, HEIGHT / CAMERA.c) == WantedArea()


def test_what_is_seen_along_the_ground_is_left_out():
    walk, bounds = block(((-1.0, 0.0), 55.0), ((1.0, 0.0), 55.0)), (-100.0, 0.0, 100.0, 200.0)
    pixel = np.hypot(HEIGHT, 14.0) / CAMERA.c
    wanted = well_seen_ground(walk, bounds, 0.0, pixel)
    grid = MapGrid(west=-100.0, north=200.0, cell=0.5, rows=400, cols=400)
    inside = wanted.cells(grid, Window(0, 0, 400, 400))
    x, y = grid.centres(Window(0, 0, 400, 400))
    # d^2 / (h c) is the pixel along the view.
    coarse = (x[None, :] ** 2 + y[:, None] ** 2 + HEIGHT**2) / (HEIGHT * CAMERA.c) / pixel
    assert inside.any() and coarse[inside].max() < 1.6 * COARSEST, "squares, and those that touch them"
    middle = np.abs(x) < 2.0
    assert inside[:, middle][(coarse < 0.9 * COARSEST)[:, middle] & (y > 6.0)[:, None]].all()
    assert not inside[coarse > 2.0 * COARSEST].any()
    west, south, east, north = wanted.bounds
    cols, rows = np.flatnonzero(inside.any(axis=0)), np.flatnonzero(inside.any(axis=1))
    assert (west, east) == pytest.approx((x[cols[0]] - 0.25, x[cols[-1]] + 0.25), abs=0.5), "the grid ends with them"
    assert (south, north) == pytest.approx((y[rows[-1]] - 0.25, y[rows[0]] + 0.25), abs=0.5)


def test_a_block_of_nothing_but_background_is_kept_whole():
    walk = block(((-1.0, 0.0), 70.0), ((1.0, 0.0), 70.0))
    assert well_seen_ground(walk, (-100.0, 100.0, 100.0, 200.0), 0.0, HEIGHT / CAMERA.c) == WantedArea()


def test_a_second_place_stays_and_scraps_go():
    squares = np.zeros((40, 40), bool)
    squares[2:20, 2:20] = squares[25:35, 25:35] = squares[2:4, 30:32] = True
    kept = _without_scraps(squares)
    assert kept[2:20, 2:20].all() and kept[25:35, 25:35].all() and not kept[2:4, 30:32].any()


def test_the_border_is_that_of_the_frames_and_no_stairs():
    """Two photographs turned by 30 degrees show one rectangle, two others look along the ground."""
    turned = block(((0.0, 0.0), 0.0), ((0.1, 0.0), 0.0), ((0.0, 0.0), 85.0), ((0.1, 0.0), 85.0))
    photos = tuple(p.model_copy(update={"omega_phi_kappa": (*p.omega_phi_kappa[:2], 30.0)}) for p in turned.photos[:2])
    wanted = well_seen_ground(
        turned.model_copy(update={"photos": (*photos, *turned.photos[2:])}), (-12.0, -12.0, 12.0, 60.0), 0.0, HEIGHT / CAMERA.c
    )
    ((ring,),) = wanted.polygons
    assert len(ring) < 40, "frames have four sides"
    xy = np.array(ring)
    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    along, across = xy @ [c, s], xy @ [-s, c]
    assert np.abs(along).max() < 5.0 + 1.0 and across.min() > -4.0 - 1.0


def test_holes_are_rings_of_their_own_and_parts_polygons():
    at = np.arange(21.0)
    wanted = np.zeros((20, 20), bool)
    wanted[1:12, 1:12] = wanted[15:19, 15:19] = True
    wanted[4:9, 4:9] = False
    polygons = _outlines(_Squares(at, at, np.where(wanted, 1.0, np.inf)), wanted, 3.0)
    assert sorted(len(rings) for rings in polygons) == [1, 2]
    area = WantedArea(polygons=polygons).cells(MapGrid(west=0.0, north=20.0, cell=1.0, rows=20, cols=20), Window(0, 0, 20, 20))[
        ::-1
    ]
    assert area[wanted].all() and not area[6, 6] and not area[13, 13]
