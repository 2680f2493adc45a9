"""Surveyed points between reference systems: published coordinates, vertical datums, and the mistakes that people make."""

import numpy as np
import pytest
from pyproj import CRS, Transformer
from pyproj.transformer import TransformerGroup

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.maps.geoid_grids import with_grids_of_the_system
from orthomill.tasks.geometry.survey_system import fitting_system, survey_crs, system_name, transform_surveyed, vertical_name

SITE = np.array([[407100.0, 4357010.0, 100.0], [407300.0, 4357400.0, 120.0], [407000.0, 4357100.0, 110.0]])
GREECE = "EPSG:2100"


def test_the_published_example_of_the_transverse_mercator_projection():
    """EPSG guidance note 7-2, section 3.5.3.1: 50 30' N, 0 30' E on OSGB36 is E 577274.99, N 69740.50 of the British grid."""
    xyz, only = transform_surveyed(np.array([[0.5, 50.5, 12.0]]), "EPSG:4277", "EPSG:27700")
    assert xyz[0] == pytest.approx((577274.99, 69740.50, 12.0), abs=0.01) and only is None


def test_the_published_example_of_the_lambert_projection_in_feet():
    """EPSG guidance note 7-2, section 3.1.1.2: X 2963503.91, Y 254759.80 US survey feet is 28 30' N, 96 00' W on NAD27."""
    here, _ = transform_surveyed(np.array([[2963503.91, 254759.80, 0.0]]), "EPSG:32040", "EPSG:26714")
    there, _ = transform_surveyed(np.array([[-96.0, 28.5, 0.0]]), "EPSG:4267", "EPSG:26714")
    np.testing.assert_allclose(here, there, atol=0.005)


def test_points_of_the_project_system_are_returned_as_they_are():
    points, only = transform_surveyed(SITE, GREECE, GREECE)
    assert points is SITE and only is None


def test_there_and_back_through_degrees():
    there, _ = transform_surveyed(SITE, GREECE, "EPSG:32634")
    back, _ = transform_surveyed(there, "EPSG:32634", GREECE)
    np.testing.assert_allclose(back, SITE, atol=0.01)
    assert (there[:, 2] == SITE[:, 2]).all()


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("EPSG:2100", None),
        ("EPSG:4326", None),
        ("EPSG:4979", "ellipsoid of WGS 84"),
        ("EPSG:32634+4979", "ellipsoid of WGS 84"),
        ("EPSG:32634+5773", "EGM96 height"),
        ("EPSG:2100+5773", "EGM96 height"),
    ],
)
def test_the_vertical_datum_is_read_from_the_system(text, name):
    assert vertical_name(text) == name


@pytest.mark.parametrize(
    ("source", "target", "stated"), [("EPSG:4979", GREECE, "EPSG:4979"), (GREECE, "EPSG:32634+5773", "EPSG:32634+5773")]
)
def test_heights_stay_where_one_system_alone_defines_them(source, target, stated):
    points = SITE if source == GREECE else np.array([[22.9, 39.4, 55.0]])
    out, only = transform_surveyed(points, source, target)
    assert (out[:, 2] == points[:, 2]).all()
    assert only == stated


@pytest.mark.filterwarnings("ignore:Best transformation")
def test_a_missing_geoid_is_refused_and_not_guessed():
    with_grids_of_the_system()  # as the transformation does: packages of some programs bring the grid
    group = TransformerGroup(CRS("EPSG:4979"), CRS("EPSG:32634+5773"), always_xy=True)
    if group.best_available:
        pytest.skip("the grid is installed here")
    said = r"PROJ lacks the grid us_nga_egm96_15\.tif; get it with: python -m pyproj sync --file .*cdn\.proj\.org.*proj-data"
    with pytest.raises(WorkflowError, match=said):
        transform_surveyed(np.array([[22.9, 39.4, 55.0]]), "EPSG:4979", "EPSG:32634+5773")


def test_ellipsoidal_heights_of_two_frames_differ_by_the_shift_of_the_frames():
    """From geocentric coordinates to longitude, latitude, height of the same ellipsoid and back: nothing is lost."""
    xyz = np.array([[22.9, 39.4, 55.0]])
    earth = np.column_stack(Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform(*xyz.T))
    out, only = transform_surveyed(earth, "EPSG:4978", "EPSG:4979")
    assert only is None
    np.testing.assert_allclose(out, xyz, atol=1e-8)


def test_coordinates_outside_of_a_projection_are_named():
    with pytest.raises(WorkflowError, match="Coordinates cannot be transformed from EPSG:4326 to EPSG:32634: they lie outside"):
        transform_surveyed(np.array([[407100.0, 4357010.0, 1.0]]), "EPSG:4326", "EPSG:32634")


@pytest.mark.parametrize(("text", "code"), [("WGS84 UTM 34N", 32634), ("wgs84 utm 16S", 32716), (" EPSG:2100 ", 2100)])
def test_spellings_of_a_system(text, code):
    assert survey_crs(text).to_epsg() == code


@pytest.mark.parametrize("text", ["WGS84 UTM N", "WGS84 UTM 34X", "Greece"])
def test_an_unknown_system_is_told_with_examples(text):
    with pytest.raises(WorkflowError, match=f"'{text}' of the control points is not known to PROJ; name it in the workflow"):
        survey_crs(text)


def as_system(code):
    x, y = Transformer.from_crs(GREECE, code, always_xy=True).transform(SITE[:, 0], SITE[:, 1])
    return np.column_stack([x, y, SITE[:, 2]])


@pytest.mark.parametrize(
    ("points", "fits"),
    [
        (SITE, (GREECE, False)),
        (SITE[:, [1, 0, 2]], (GREECE, True)),
        (as_system("EPSG:32634"), ("EPSG:32634", False)),
        (as_system("EPSG:32635"), ("EPSG:32635", False)),
        (as_system("EPSG:3857"), ("EPSG:3857", False)),
        (as_system("EPSG:4326"), ("EPSG:4326", False)),
        (as_system("EPSG:4326")[:, [1, 0, 2]], ("EPSG:4326", True)),
        (as_system("EPSG:32634")[:, [1, 0, 2]], ("EPSG:32634", True)),
        (SITE + np.array([9e6, 0, 0]), None),
    ],
)
def test_the_usual_mistakes_are_recognised(points, fits):
    assert fitting_system(points, GREECE, GREECE, SITE[0, :2]) == fits


@pytest.mark.parametrize(
    ("place", "grid"),
    [((-2.752, 54.512), "EPSG:27700"), ((21.0, 52.2), "EPSG:2180"), ((2.35, 48.85), "EPSG:2154"), ((7.45, 46.95), "EPSG:2056")],
)
def test_the_grid_of_the_country_is_found(place, grid):
    """Points from a national grid, read in the UTM zone that was proposed for the flight."""
    utm = f"EPSG:{32601 + int((place[0] + 180) // 6)}"
    points = np.array([[*Transformer.from_crs("EPSG:4326", grid, always_xy=True).transform(*place), 264.0]])
    site = np.array(Transformer.from_crs("EPSG:4326", utm, always_xy=True).transform(*place))
    assert fitting_system(points, utm, utm, site) == (grid, False)


def test_the_site_and_not_the_numbers_decides():
    """The same points are on another site when the photographs were taken 60 km away."""
    assert fitting_system(SITE, GREECE, GREECE, SITE[0, :2] + [0, 60_000.0]) is None


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("EPSG:32632+4979", "WGS 84 / UTM zone 32N, heights above the ellipsoid (EPSG:32632+4979)"),
        ("EPSG:2100+5773", "GGRS87 / Greek Grid, heights: EGM96 height (EPSG:2100+5773)"),
        ("EPSG:2100", "GGRS87 / Greek Grid (EPSG:2100)"),
        ("the site's own", "the site's own"),
    ],
)
def test_a_system_is_called_as_people_call_it(text, name):
    assert system_name(text) == name
