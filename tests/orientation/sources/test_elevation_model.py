"""An elevation model is read below the photographs, and interpolated between its cells."""

import numpy as np
import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.orientation.sources.elevation_model import Elevation, ElevationFile, ElevationModel, Lattice

GRID = MapGrid(west=1000.0, north=2000.0, cell=2.0, rows=30, cols=40)
ORIGIN = np.array([1030.0, 1970.0, 100.0])


def photographs(*places):
    usual = {"width": 100, "height": 100, "bands": 3, "dtype": "uint8", "camera": "c"}
    return Photos(photos=tuple(Photo(name=f"p{i}", path=f"p{i}", position=place, **usual) for i, place in enumerate(places)))


def test_a_plane_is_interpolated_exactly_and_nothing_is_known_outside():
    x, y = GRID.centres(Window(0, 0, *GRID.shape))
    heights = 120.0 + 0.1 * (x[None, :] - 1030.0) - 0.2 * (y[:, None] - 1970.0)
    model = ElevationModel(Elevation(heights, Lattice(GRID, 0.5)), ORIGIN)
    places = np.random.default_rng(1).uniform([-28, -28, 0], [48, 28, 0], (200, 3))
    height, slope = model.at(places)
    assert height == pytest.approx(20.0 + 0.1 * places[:, 0] - 0.2 * places[:, 1], abs=1e-9)
    assert slope == pytest.approx(np.tile([0.1, -0.2], (200, 1)), abs=1e-9)
    assert np.isnan(model.at(np.array([[-40.0, 0, 0], [0, 40.0, 0], [60.0, 0, 0]]))[0]).all()


def test_it_is_read_below_the_photographs_and_around_them():
    own = ElevationFile(path="dem.tif", sigma=0.5, system="EPSG:2100+5773")
    grid = own.lattice(photographs((500.0, 900.0, 50.0), None, (1500.0, 700.0, 50.0))).grid
    assert grid.west <= 0.0 and grid.north >= 1400.0 and max(grid.shape) <= 500
    assert grid.west + grid.cols * grid.cell >= 2000.0 and grid.north - grid.rows * grid.cell <= 200.0


def test_without_positions_or_heights_it_is_refused():
    own = ElevationFile(path="dem.tif", sigma=0.5)
    with pytest.raises(WorkflowError, match=r"dem\.tif is compared with the positions .* leave 'elevation' out"):
        own.lattice(photographs(None))
    with pytest.raises(WorkflowError, match=r"dem\.tif has no height where the photographs were taken"):
        Elevation(np.full(GRID.shape, np.nan), Lattice(GRID, 0.5, "dem.tif")).checked()
