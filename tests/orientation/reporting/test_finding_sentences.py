"""Every finding has a sentence, with its names, its numbers and a remedy."""

from typing import get_args

import pytest
from pydantic import TypeAdapter

from orthomill.schemas.findings import block_findings as f
from orthomill.schemas.findings.finding import SpokenFinding
from orthomill.schemas.findings.observation_findings import Misfit
from orthomill.schemas.orientation import BlockPrecision

KINDS = get_args(get_args(f.BlockFinding)[0])
NOWHERE = (Misfit(photo="a", misfit_px=None), Misfit(photo="b", misfit_px=None, lies_on="P9"))
OFF = (Misfit(photo="a", misfit_px=14.6), Misfit(photo="b", misfit_px=7.2, lies_on="P9"))

SPOKEN = [
    (f.NoDatum(scaled=True), ["has a scale but no datum", "three control points"]),
    (f.NoDatum(scaled=True, scale_share=0.12), ["an approximate scale (to 12 %) but no datum"]),
    (f.NoDatum(scaled=False), ["has no datum", "not metres", "Give positions"]),
    (
        f.ControlUnmet(points=3, measured=4, turned=True),
        ["3 of the 4 control points", "as EXIF turns them", "the frame before that", "another size"],
    ),
    (f.ControlUnmet(points=3, measured=4, turned=False), ["those of another size or another photograph"]),
    (
        f.MarksInAnotherFrame(counted="from below", change="turn them", given_px=140.2, found_px=0.61, points=5),
        ["marks of the 5 control points are counted from below", "to 0.61 px", "to 140 px", "turn them"],
    ),
    (f.PositionsCrowded(), ["closer together than their own standard errors", "true precision"]),
    (f.TiltUnobserved(tilt_sigma_deg=None, basis="down", sigma_deg=5.0), ["do not determine", "straight down", "5.0 degrees"]),
    (f.TiltUnobserved(tilt_sigma_deg=70.0, basis="level", sigma_deg=4.9), ["do not determine", "taken level", "4.9 degrees"]),
    (f.TiltUnobserved(tilt_sigma_deg=2.0, basis="attitude", sigma_deg=1.9), ["determine only to 2.0 degrees", "attitudes"]),
    (f.ControlOnALine(), ["nearly on one line", "Add control"]),
    (f.DatumMisfit(ratio=12.4), ["12 standard errors", "CRS"]),
    (
        f.BlockBent(bend_m=-0.59, extent_m=61.0, pixels=27.3, scatter_m=0.007, views_deg=-6.2, grave=True),
        [
            "bends by 0.59 m over 61 m (27 pixels on the ground, a dome)",
            "scatter by only 0.007 m",
            "6.2 degrees",
            "not the receiver",
        ],
    ),
    (
        f.BlockBent(bend_m=-0.89, extent_m=87.0, pixels=24.5, scatter_m=0.137, views_deg=None, grave=True, sure=False),
        ["scatter by only 0.14 m", "the camera is wrong, or heights of a barometer"],
    ),
    (
        f.BlockBent(bend_m=-0.89, extent_m=87.0, pixels=24.5, scatter_m=0.137, views_deg=None, grave=True, sure=False, open_m=0.4),
        ["leave it open (standard error 0.4 m)", "positions > sigma_height: 0.14)"],
    ),
    (
        f.BlockBent(bend_m=1.2, extent_m=90.0, pixels=31.0, scatter_m=None, views_deg=2.0, grave=True, in_metres=False),
        ["The block bends by 31 pixels on the ground (a bowl) against the attitudes"],
    ),
    (
        f.BlockBent(bend_m=-1.7, extent_m=86.0, pixels=20.0, scatter_m=0.12, views_deg=None, grave=True, without_control_m=0.58),
        ["the control bends it", "without the control the same photographs bend by 0.58 m only", "control: {kind: none}"],
    ),
    (
        f.BlockBent(bend_m=-1.7, extent_m=86.0, pixels=20.0, scatter_m=0.12, views_deg=None, grave=True, without_control_m=1.6),
        ["not the receiver but the camera is wrong"],
    ),
    (
        f.BlockBent(bend_m=0.074, extent_m=47.0, pixels=3.1, scatter_m=None, views_deg=1.1, grave=False),
        ["bends by 0.074 m", "a bowl", "about what a model of the lens leaves"],
    ),
    (f.LooksUpward(), ["upwards from below", "X and Y"]),
    (f.AxesExchanged(exchanged_m=0.021, given_m=321.0), ["to 0.02 m", "only to 321.00 m", "Exchange X and Y in the file"]),
    (
        f.PointsExchanged(first="P1", second="P7", exchanged_m=0.041, given_m=12.4),
        ["points P1 and P7 seem to be exchanged", "to 0.04 m, as given to 12.40 m", "Neither was used"],
    ),
    (f.PointsExchanged(first="P1", second="P7", exchanged_m=0.041, given_m=None), ["as given it shows the ground from below"]),
    (
        f.DistortionFolds(camera="cam", reach_px=912.3, corner_px=1180.2, k1=-0.3, c=1165.0),
        ["camera cam", "912 px", "1180 px away", "k1 = -0.3, c = 1165 px", "another camera"],
    ),
    (f.InteriorUndetermined(camera="cam", share=0.07), ["c, x0, y0 of cam", "only to 7 %", "kept their values", "calibration"]),
    (f.InteriorUndetermined(camera="cam", share=None), ["not at all"]),
    (f.InteriorFixed(cameras=("one", "two")), ["of one and two", "kept as it was given", "oblique"]),
    (f.InteriorFixed(cameras=("one", "two", "three")), ["of 3 cameras (one, two, three)", "heights may bend"]),
    (f.DatumGivenUp(worst=("gcp04", "IMG_7")), ["gcp04, IMG_7", "without any of them"]),
    (f.InteriorUnweighted(cameras=("one", "two")), ["of one and two", "without standard errors", "sigma_c"]),
    (
        f.ConstantContradicted(camera="cam", given_px=800.0, adjusted_px=1597.4, sigma_px=12.3, fixed=False, guessed=True),
        ["No tag tells the camera constant of cam: 800 px were guessed, 1597 px", "fit and were used"],
    ),
    (
        f.ConstantContradicted(camera="cam", given_px=800.0, adjusted_px=1597.4, sigma_px=0.456, fixed=False),
        ["800 px were given", "1597 px (standard error 0.46 px) fit", "which was used"],
    ),
    (
        f.ConstantContradicted(camera="cam", given_px=800.0, adjusted_px=1597.4, sigma_px=12.3, fixed=True),
        ["standard error 12 px", "but the workflow fixes it"],
    ),
    (
        f.LensContradicted(camera="cam", given=(-0.1, 0.02), fits=(-0.083, 0.011), border_px=3.41, ratio=12.3),
        ["k1 = -0.1, k2 = 0.02 was given", "about k1 = -0.083, k2 = 0.011 fits", "by 3.4 px (12 standard errors)"],
    ),
    (f.ConstantNominal(camera="cam", c=1165.0, share=0.03), ["(nominal, from EXIF, 1165 px, within 3 %)", "three control points"]),
    (f.ConstantNominal(camera="cam", c=1165.0, share=0.25, guessed=True), ["(guessed, as no tag tells it, 1165 px, within 25 %)"]),
    (
        f.InteriorDemanded(camera="cam", x0_px=-7.1, y0_px=-14.4, k3=-0.13, sigma0_px=(0.138, 0.112)),
        ["x0 = -7.1 px, y0 = -14.4 px and k3 = -0.13", "sigma0 0.138 px without, 0.112 px with", "heights would bend"],
    ),
    (f.PrincipalPointMoved(camera="cam", moved_px=31.4), ["of cam moved 31 px", "fix x0 and y0"]),
    (
        f.ImageErrorsCorrelated(rms_px=0.71, camera_share=0.8, parameter="c", owner="cam", sigma=6.0, white_sigma=1.5),
        ["0.71 px on average", "mostly alike", "c of cam is known to 6 px, not to 1.5 px"],
    ),
    (
        f.ImageErrorsCorrelated(
            rms_px=0.79, shown_px=0.04, camera_share=0.8, parameter="y0", owner="cam", sigma=24.0, white_sigma=1.1
        ),
        ["alike by 0.04 px, mostly alike in all", "displacements by about 0.79 px", "can absorb", "known to 24 px, not to 1.1 px"],
    ),
    (
        f.ImageErrorsCorrelated(rms_px=0.71, camera_share=0.2, parameter="Z", owner="a", sigma=6.0, white_sigma=1.5),
        ["mostly different in each", "Z of a is known to 6"],
    ),
    (
        f.ControlContradicted(point="P1", difference=(0.5, -1.25, 0.01), ratio=17.2),
        ["control point P1", "+0.50, -1.25, +0.01 m", "17 times", "took no part"],
    ),
    (f.PositionContradicted(photo="a", difference=(9.0, 0.0, 0.0), ratio=90.0), ["position of a", "+9.00", "90 times"]),
    (f.PositionsElsewhere(photos=6, distance_m=53852.0), ["6 photographs", "53.9 km", "another CRS"]),
    (f.PositionsElsewhere(photos=6, distance_m=87.6), ["88 m"]),
    (
        f.OffsetAdjusted(
            photos=("a", "b", "c"),
            against="others",
            offset=(None, None, 15.12),
            sigma=(None, None, 0.41),
            tilt_deg=10.04,
            moved_m=9.6,
            zoom=1.084,
        ),
        [
            "1.08 times the camera constant (zoom, a second camera) would put them there, too",
            "if theirs are, all lies 15.12 m higher",
            "heights of the positions of a to c (3 photographs) lie 15.12 m (standard error 0.41 m) above those of the others",
            "10.0 deg",
        ],
    ),
    (
        f.OffsetAdjusted(
            photos=("a", "b"), against="others", offset=(0.3, -0.2, 0.1), sigma=(0.01,) * 3, tilt_deg=0.1, moved_m=0.3
        ),
        ["positions of a, b lie +0.30 m in X (standard error 0.01 m), -0.20 m in Y", "+0.10 m in height", "give control"],
    ),
    (
        f.OffsetAdjusted(
            photos=("a", "b"),
            against="others",
            offset=(0.3, 1.16, 0.1),
            sigma=(0.1,) * 3,
            tilt_deg=0.1,
            moved_m=0.3,
            stated=(3.0, 3.0, 5.0),
        ),
        ["+1.16 m in Y (standard error 0.1", "no more than what is stated of them", "stays as uncertain as stated."],
    ),
    (
        f.OffsetAdjusted(
            photos=("a", "b", "c"),
            against="control",
            offset=(None, None, 47.23),
            sigma=(None, None, 0.05),
            tilt_deg=0.0,
            moved_m=47.2,
            heights="ellipsoidal",
        ),
        ["(the tags say: above the ellipsoid) lie 47.23 m (standard error 0.05 m) above the control", "both keep", "height system"],
    ),
    (
        f.PositionsDrift(photos=("a", "b", "c"), hours=0.4, drift=(None, 0.01, -0.3), sigma=(None, 0.02, 0.04)),
        [
            "positions of a to c (3 photographs) drift against the block, in 24 min by +0.01 m in Y",
            "-0.30 m in height",
            "control at",
        ],
    ),
    (
        f.ScaleContradicted(factor=1.00038, sigma=0.00001, map_factor=0.99962),
        ["In plan the control is 1.00038 times as large", "what distances on the ground are on this map (1 m is 0.99962 m on it)"],
    ),
    (
        f.ScaleContradicted(factor=1.46, sigma=0.01, map_factor=0.99962),
        ["is 1.46000 times as large", "A web map, distances on the ground, another projection"],
    ),
    (
        f.UnitContradicted(unit="feet", heights_only=True, given_m=368.2, fits_m=0.1, crs="EPSG:26849", heights_m=(532.7, 162.4)),
        [
            "heights of the control are in feet",
            "by 368.2 m",
            "by 0.1 m",
            "write crs: EPSG:26849+6360 below control (heights in US survey feet)",
            "at 162.4 m instead of 532.7 m",
        ],
    ),
    (
        f.UnitContradicted(unit="metres", heights_only=True, given_m=36.2, fits_m=0.1, crs="EPSG:26849+6360"),
        ["metres that were taken for feet", "+5703 below control (heights in metres)."],
    ),
    (
        f.ConstantOfItsOwn(photos=("a", "b"), camera="cam", c_px=1265.0, others_px=1150.0, used=False),
        ["By their positions a, b were taken with 1.1 times", "kept one camera", "camera > serves"],
    ),
    (
        f.ConstantOfItsOwn(photos=("a", "b", "c"), camera="cam", c_px=1725.0, others_px=1150.0),
        ["a to c (3 photographs)", "1.5 times the camera constant", "of cam (1725 and 1150 px)", "a camera of their own"],
    ),
    (
        f.UnitContradicted(unit="metres", heights_only=False, given_m=36.2, fits_m=0.1),
        ["coordinates of the control are in metres that were taken for feet"],
    ),
    (
        f.SourcesDisagree(
            source="attitudes", parameter="tilt about X", unit="degrees", value=0.1, sigma=0.6, others=9.8, others_sigma=0.7
        ),
        ["in the tilt about X", "attitudes would change it by +0.10 degrees (standard error 0.60)", "all others by +9.80"],
    ),
    (f.PositionsAlongView(photos=6, along_m=-38.4), ["by 38.4 m along the viewing direction", "above the sea"]),
    (
        f.DistanceContradicted(first="A", second="B", length=12.5, difference=0.25, ratio=9.0, outcome="excluded"),
        ["from A to B (12.500 m) contradicts the block", "+0.250 m, 9 times", "it took no part"],
    ),
    (
        f.DistanceContradicted(first="A", second="B", length=12.495, measured=12.5, difference=0.25, ratio=9.0, outcome="check"),
        ["from A to B (measured 12.500 m, on the map 12.495 m) contradicts", "as one to a check point"],
    ),
    (
        f.DistanceContradicted(first="A", second="B", length=12.5, difference=0.25, ratio=9.0, outcome="undecided"),
        ["contradicts the block", "too few others show which"],
    ),
    (
        f.DistanceContradicted(first="A", second="B", length=12.5, difference=-0.25, ratio=1.0, outcome="downweighted"),
        ["contradicts the other distances", "-0.250 m", "lies between them"],
    ),
    (f.DistanceUnchecked(), ["One distance alone gives the scale", "measure two more"]),
    (
        f.MeasurementsRejected(role="control", point="P1", measured=5, rejected=NOWHERE),
        ["2 of 5 measurements", "a (not where the block sees it), b (not where the block sees it, where P9 lies)"],
    ),
    (
        f.MeasurementsRejected(role="control", point="P1", measured=5, rejected=OFF),
        [
            "2 of 5 measurements of the control point P1",
            "a (15 px off), b (7 px off, where P9 lies)",
            "Give those on another point its name",
        ],
    ),
    (
        f.MeasurementsRejected(role="tie", point="P1", measured=5, rejected=OFF[:1]),
        ["1 of 5 measurements of the tie point P1", "Measure it again"],
    ),
    (
        f.CheckMeasurementsApart(point="P1", measured=3, apart=OFF[:1]),
        ["1 of 3 measurements of the check point P1", "a (15 px off)", "Measure again"],
    ),
    (f.GroupsUnconnected(groups=(("a", "b", "c"), ("d", "e"), ("g", "h"))), ["3 groups", "Apart from the largest: d, e; g, h."]),
    (f.BlockSeparate(photos=("d", "e")), ["d, e form a separate group", "free block of its own"]),
    (f.LargestReconstruction(count=3, photos=17), ["3 reconstructions", "of 17 photographs"]),
    (f.PhotosUnknown(photos=tuple("abcdefghij")), ["10 photographs", "a, b, c, d, e, f, g, h and 2 more"]),
    (f.BlockElsewhere(source="ori.csv", offset=(0.1, -0.2, 43.0)), ["ori.csv", "+0.1, -0.2, +43.0 m", "height system"]),
    (f.TiePointsMisfit(source="ori.csv", rms_px=34.5, factor=115.0), ["ori.csv by 34.5 px", "115 times", "kind: adjusted"]),
    (f.BlockUnexamined(source="ori.csv"), ["No tie points", "ori.csv", "stage tie_points"]),
]


@pytest.mark.parametrize(("finding", "phrases"), SPOKEN, ids=lambda value: getattr(value, "code", ""))
def test_a_sentence_holds_the_names_and_numbers_of_its_finding(finding, phrases):
    sentence = finding.sentence
    assert [phrase for phrase in phrases if phrase not in sentence] == []
    assert sentence.endswith(".")
    assert "nan" not in sentence and "None" not in sentence


def test_every_kind_of_finding_is_spoken_above():
    assert {type(finding) for finding, _ in SPOKEN} == set(KINDS)


def test_codes_are_unique():
    codes = [kind.model_fields["code"].default for kind in KINDS]
    assert len(set(codes)) == len(codes) == len(KINDS)


@pytest.mark.parametrize("finding", [finding for finding, _ in SPOKEN], ids=lambda finding: finding.code)
def test_a_finding_survives_its_table(finding):
    table = BlockPrecision(image_factor=1.0, position_factor=1.0, control_factor=1.0, rays=0, rejected=0, findings=(finding,))
    assert BlockPrecision.model_validate_json(table.model_dump_json()).findings == (finding,)


def test_a_code_decides_which_finding_is_read():
    read = TypeAdapter(f.BlockFinding).validate_python({"code": "positions_elsewhere", "photos": 3, "distance_m": 5.0})
    assert read == f.PositionsElsewhere(photos=3, distance_m=5.0)


def test_a_finding_without_words_is_an_error_of_the_program():
    class Unspoken(SpokenFinding):
        code: str = "unspoken"

    with pytest.raises(NotImplementedError, match="Unspoken has no sentence"):
        Unspoken().sentence  # noqa: B018
