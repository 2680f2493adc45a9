"""Metres are told only where lengths are metres."""

from orthomill.pipeline.report.present_reports import UNITS, in_own_lengths
from orthomill.schemas.raster import NO_UNIT, MapGrid, map_raster
from orthomill.schemas.stage_report import Answer, Figure, Picture, StageReport, Topic, Verdict

METRES = StageReport(
    figures=(
        Figure(name="nmad", value=0.07, unit="m", sentence="Spread of 0.07 m."),
        Figure(name="x", value=1, unit="mm", sentence=""),
    ),
    pictures=(Picture(title="Heights", raster="densification/height", style="ramp", unit="m", caption="12 m to 18\u202fm, 3 m2"),),
    answers=(Answer(topic=Topic.HEIGHTS, text="to 0.069 m among their neighbours, 5 mm in images, 2.26 ha"),),
    verdict=Verdict(level="fair", sentence="An error of 0.4 m, 11 m wide."),
)


def test_from_the_block_without_scale_on_there_are_no_metres():
    block = METRES.model_copy(update={"lengths": "the block has no scale"})
    shown = in_own_lengths({"calibration": METRES, "orientation": block, "densification": METRES})
    assert list(shown) == ["calibration", "orientation", "densification"] and shown["calibration"] == METRES
    for kind in ("orientation", "densification"):
        report = shown[kind]
        assert [figure.unit for figure in report.figures] == [UNITS, "mm"]
        assert report.figures[0].sentence == "Spread of 0.07 units." and report.pictures[0].unit == UNITS
        assert report.pictures[0].caption == "12 units to 18\u202funits, 3 m2"
        assert report.answers[0].topic is Topic.HEIGHTS
        assert report.answers[0].text == "to 0.069 units among their neighbours, 5 mm in images, 22,600 square units".replace(
            ",600", "\u202f600"
        )
        assert report.verdict.sentence == "An error of 0.4 units, 11 units wide."


def test_a_block_with_scale_keeps_its_metres():
    assert in_own_lengths({"orientation": METRES, "densification": METRES}) == {"orientation": METRES, "densification": METRES}


def test_rasters_of_heights_without_metres_say_so():
    grid = MapGrid(west=0.0, north=10.0, cell=1.0, rows=10, cols=10)
    own = f'ENGCRS["local",EDATUM["none"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],LENGTHUNIT["{NO_UNIT}",1]]'
    assert map_raster("dsm", grid, "float32", own, 256, unit="m").unit == NO_UNIT
    assert map_raster("dsm", grid, "float32", own, 256, unit="px").unit == "px"
    assert map_raster("dsm", grid, "float32", "EPSG:2100", 256, unit="m").unit == "m"
