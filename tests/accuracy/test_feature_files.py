"""Features in, answers out: GeoPackage, GeoJSON and CSV."""

import json
import math

import numpy as np
import pytest

from orthomill.pipeline.storage.answer_files import answers_csv, write_answers
from orthomill.pipeline.storage.features.feature_files import read_features
from orthomill.schemas.accuracy.surface_answers import DrawnFeature, MeasuredAnswers, ProfilePoint, SurfaceAnswer
from orthomill.schemas.errors import StoreError, WorkflowError

FEATURES = (
    DrawnFeature("a", "point", np.array([[500000.0, 4000000.0]])),
    DrawnFeature("b", "line", np.array([[500000.0, 4000000.0], [500010.0, 4000020.0]])),
    DrawnFeature("c", "polygon", np.array([[500000.0, 4000000.0], [500009.0, 4000000.0], [500009.0, 4000009.0]])),
)
ANSWERS = MeasuredAnswers(
    tuple(SurfaceAnswer(f.name, "height", 1.5, math.nan, "m") for f in FEATURES),
    (ProfilePoint("b", 0, 500000, 4000000, 1, 0.1, True),),
    "as it is",
)


def test_a_geopackage_of_answers_is_read_back_as_features(tmp_path):
    write_answers(tmp_path / "out.gpkg", ANSWERS, FEATURES, "EPSG:32634+5773")
    found = read_features(tmp_path / "out.gpkg", "EPSG:32634")
    assert [f.kind for f in found] == ["point", "line", "polygon", "point"]
    for one, other in zip(found, FEATURES, strict=False):
        np.testing.assert_array_equal(one.places, other.places)


def test_a_polygon_keeps_its_holes_there_and_back(tmp_path):
    ring, hole = FEATURES[2].places, np.array([[500005.0, 4000001.0], [500008.0, 4000001.0], [500008.0, 4000004.0]])
    feature = DrawnFeature("c", "polygon", ring, (hole,))
    answers = MeasuredAnswers((SurfaceAnswer("c", "area", 1.0, 0.1, "m2"),), (), "")
    write_answers(tmp_path / "out.gpkg", answers, (feature,), "EPSG:32634")
    (found,) = read_features(tmp_path / "out.gpkg", "EPSG:32634")
    np.testing.assert_array_equal(found.places, ring)
    np.testing.assert_array_equal(found.holes[0], hole)
    (moved,) = read_features(tmp_path / "out.gpkg", "EPSG:2100")
    assert np.abs(moved.holes[0] - moved.places[0]).max() < 12 and abs(moved.holes[0][0, 0] - 500005) > 100


def test_geojson_is_in_degrees_and_is_moved(tmp_path):
    collection = {
        "features": [
            {
                "properties": {"name": "p"},
                "geometry": {"type": "Polygon", "coordinates": [[[21, 36], [21.001, 36], [21, 36.001], [21, 36]]]},
            }
        ]
    }
    (tmp_path / "a.geojson").write_text(json.dumps(collection))
    (found,) = read_features(tmp_path / "a.geojson", "EPSG:32634")
    assert found.kind == "polygon" and len(found.places) == 3
    assert found.places[0] == pytest.approx((500000, 3983948.45), abs=0.1)


def test_points_come_from_csv(tmp_path):
    (tmp_path / "p.csv").write_text("name,x,y,z,sigma_z\nA,1,2,9,0.1\n# no\nB,3,4\n")
    assert [(f.name, *f.places[0]) for f in read_features(tmp_path / "p.csv", "EPSG:32634")] == [("A", 1, 2), ("B", 3, 4)]


@pytest.mark.parametrize(
    ("name", "text"), [("a.csv", "A,1,x\nB,2,y\n"), ("a.geojson", "{"), ("a.gpkg", "no"), ("a.shp", ""), ("a.csv", "")]
)
def test_what_cannot_be_read_is_said_in_one_sentence(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(WorkflowError, match="a\\."):
        read_features(tmp_path / name, "EPSG:32634")


def test_coordinates_of_a_map_in_a_file_of_degrees_are_named_as_that(tmp_path):
    path = tmp_path / "field.geojson"
    ring = [[351250, 512900], [351330, 512900], [351330, 512950], [351250, 512900]]
    shape = {"type": "Feature", "properties": {"name": "field"}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [shape]}))
    with pytest.raises(WorkflowError, match=r"field lies nowhere in EPSG:27700.*longitude and latitude"):
        read_features(path, "EPSG:27700")


def test_answers_without_a_value_stay_empty(tmp_path):
    assert "a,height,1.5,,m" in answers_csv(ANSWERS)
    write_answers(tmp_path / "a.json", ANSWERS, FEATURES, "EPSG:32634")
    assert json.loads((tmp_path / "a.json").read_text())["answers"][0]["sigma"] is None
    with pytest.raises(StoreError, match="written as"):
        write_answers(tmp_path / "a.shp", ANSWERS, FEATURES, "EPSG:32634")
