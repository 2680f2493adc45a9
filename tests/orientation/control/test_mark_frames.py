"""Marks of control that are counted otherwise than in the photographs: which way, of which size, and what is not decided."""

import numpy as np
import pytest

from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.orientation.control.mark_frames import FoundFrame, explaining_frame, recounted

WIDTH, HEIGHT = 1200, 900
TRUTH = np.random.default_rng(3).uniform((300.0, 250.0), (700.0, 600.0), (12, 2)).reshape(4, 3, 2)
NAMES = ("a", "b", "c")


def photos(orientation: int = 1) -> Photos:
    """Three photographs, upright."""
    one = {"path": "x.jpg", "width": WIDTH, "height": HEIGHT, "bands": 3, "dtype": "uint8", "camera": "k"}
    return Photos(photos=tuple(Photo(name=name, exif_orientation=orientation, **one) for name in NAMES))


def marked(places: np.ndarray) -> list[ControlPoint]:
    """Points with marks (point, photograph, 2)."""
    return [
        ControlPoint(
            name=f"p{i}",
            role="control",
            xyz=(0.0, 0.0, 0.0),
            sigma=(0.1, 0.1, 0.1),
            measurements={n: (*map(float, at), 1.0) for n, at in zip(NAMES, row, strict=True)},
        )
        for i, row in enumerate(places)
    ]


def miss(points: list[ControlPoint]) -> float:
    """px by which marks lie off their true places, beside an error of half a pixel: what rays of points miss on a sound model."""
    found = np.array([[point.measurements[name][:2] for name in NAMES] for point in points])
    return float(np.hypot(np.sqrt(np.mean((found - TRUTH) ** 2)), 0.5))


def listed(factor: float) -> np.ndarray:
    """Pixels of the true places in copies reduced by a factor."""
    return (TRUTH + 0.5) / factor - 0.5


def test_marks_that_meet_as_they_were_read_are_left_alone():
    assert explaining_frame(marked(TRUTH), photos(), miss) is None


@pytest.mark.parametrize("factor", [0.6, 1.1719, 1.92, 3.0])
def test_copies_of_any_size_are_found(factor):
    found = explaining_frame(marked(listed(factor)), photos(), miss)
    assert found is not None and found.frame.counted == "" and found.factor == pytest.approx(factor, rel=1e-3)
    assert found.found < 1.0 < 10.0 < found.given


@pytest.mark.parametrize(
    ("counted", "upside"),
    [
        ("from the lower left corner", lambda at: np.stack([at[..., 0], HEIGHT - 1 - at[..., 1]], axis=-1)),
        ("with the row before the column", lambda at: at[..., ::-1]),
        ("in the photographs turned left by a quarter", lambda at: np.stack([at[..., 1], WIDTH - 1 - at[..., 0]], axis=-1)),
    ],
)
def test_turned_frames_are_found_in_their_own_size(counted, upside):
    found = explaining_frame(marked(upside(TRUTH)), photos(), miss)
    assert found is not None and (found.frame.counted, found.factor) == (counted, 1.0)


def test_reduced_files_before_exif_turned_them_are_found():
    """A public list of marks made in copies of 2400 px, of photographs of a kite that EXIF turns by a quarter."""
    in_file = np.stack([HEIGHT - 1 - TRUTH[..., 1], TRUTH[..., 0]], axis=-1)
    found = explaining_frame(marked((in_file + 0.5) / 1.5625 - 0.5), photos(8), miss)
    assert found is not None and found.frame.counted == "in the files as they are before EXIF turns them"
    assert found.factor == pytest.approx(1.5625, rel=1e-3)
    places = np.array([list(p.measurements.values()) for p in recounted(marked((in_file + 0.5) / 1.5625 - 0.5), photos(8), found)])
    np.testing.assert_allclose(places[..., :2], TRUTH, atol=0.5)


def test_marks_without_any_system_are_explained_by_nothing():
    assert (
        explaining_frame(marked(np.random.default_rng(9).permuted(TRUTH.reshape(12, 2)).reshape(TRUTH.shape)), photos(), miss)
        is None
    )


def test_marks_that_lie_outside_after_counting_are_left_out():
    found = explaining_frame(marked(listed(3.0)), photos(), miss)
    assert isinstance(found, FoundFrame)
    far = marked(np.full((1, 3, 2), 399.0))
    assert recounted(far, photos(), found)[0].measurements == {}
