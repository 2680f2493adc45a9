"""What is true of many cameras or photographs is said once."""

import pytest

from orthomill.schemas.findings import block_findings as f
from orthomill.tasks.orientation.report.several_findings import finding_sentences

ONE, TWO, THREE = "one", "two", "three"

SAID = [
    (
        [f.ConstantNominal(camera=name, c=c, share=0.25, guessed=True) for name, c in ((ONE, 1000.0), (TWO, 1200.0))],
        ["camera constants of 2 cameras (guessed, as no tag tells them, within 25 %)", "one (1000 px), two (1200 px)"],
    ),
    ([f.ConstantNominal(camera=name, c=9.0, share=share) for name, share in ((ONE, 0.02), (TWO, 0.05))], ["EXIF, within 2 to 5 %"]),
    (
        [
            f.ConstantContradicted(camera=name, given_px=800.0, adjusted_px=999.0, sigma_px=2.0, fixed=False, guessed=True)
            for name in (ONE, TWO)
        ],
        ["No tag tells the camera constants of 2 cameras", "one (800 px, 999 px fit)"],
    ),
    (
        [f.ConstantContradicted(camera=name, given_px=800.0, adjusted_px=999.0, sigma_px=2.0, fixed=True) for name in (ONE, TWO)],
        ["contradicts the camera constants of 2 cameras", "but the workflow fixes them"],
    ),
    ([f.PrincipalPointMoved(camera=name, moved_px=31.0) for name in (ONE, TWO)], ["of 2 cameras moved", "one (31 px), two"]),
    (
        [f.DistortionFolds(camera=name, reach_px=900.0, corner_px=1200.0, k1=-0.3, c=1000.0) for name in (ONE, TWO)],
        ["The distortion of 2 cameras", "one (900 of 1200 px)"],
    ),
    (
        [f.InteriorUndetermined(camera=ONE, share=0.07), f.InteriorUndetermined(camera=TWO, share=None)],
        ["c, x0, y0 of 2 cameras", "one (only to 7 %), two (not at all)"],
    ),
    (
        [f.TiltUnobserved(tilt_sigma_deg=tilt, basis="down", sigma_deg=s) for tilt, s in ((5.4, 3.7), (None, 5.0), (None, 5.0))],
        ["In 3 groups of photographs", "do not determine the tilt", "good to 5.0 degrees"],
    ),
    (
        [f.PositionContradicted(photo=name, difference=(d, 0.0, 0.0), ratio=d) for name, d in ((ONE, 9.0), (TWO, 20.0))],
        ["positions of 2 photographs", "two (20.0 m), one (9.0 m)"],
    ),
]


@pytest.mark.parametrize(("findings", "phrases"), SAID, ids=lambda value: value[0].code if hasattr(value[0], "code") else "")
def test_findings_of_one_kind_are_one_sentence_that_lists_them(findings, phrases):
    (sentence,) = finding_sentences(findings)
    assert [phrase for phrase in phrases if phrase not in sentence] == [] and sentence.endswith(".")


def test_what_differs_in_more_than_its_camera_is_said_apart():
    guessed = [f.ConstantNominal(camera=name, c=1000.0, share=0.25, guessed=True) for name in (ONE, TWO)]
    tagged = f.ConstantNominal(camera=THREE, c=1000.0, share=0.02)
    first, second = finding_sentences([guessed[0], tagged, guessed[1]])
    assert "2 cameras" in first and "camera constant of three" in second


def test_findings_that_differ_in_their_numbers_keep_their_sentences():
    control = [f.ControlContradicted(point=name, difference=(1.0, 2.0, 3.0), ratio=9.0) for name in (ONE, TWO)]
    assert len(list(finding_sentences(control))) == 2
