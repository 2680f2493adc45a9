"""The map of window sizes of one photograph: strips, orientation, bit depth, shares, and every refusal with its sentence."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.inspections.inspection import PhotoMap
from orthomill.schemas.photo import Header
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.upright import upright
from orthomill.tasks.inspections import window_size
from orthomill.tasks.inspections.window_size import Method, share_of, sizing_of, window_size_map
from orthomill.tasks.matching.windows.size_map import published_levels, size_map
from orthomill.tasks.matching.windows.sizes import grey_levels
from orthomill.tasks.matching.windows.window_settings import (
    CombinedWindow,
    EntropyWindow,
    FixedWindow,
    FoerstnerWindow,
    StatisticalWindow,
    WindowSizing,
)

SMALL = FoerstnerWindow(largest=15)


@dataclass(frozen=True)
class InMemory:
    """A photograph whose file is an array (rows, cols, bands); it counts the pixels that are asked for at once."""

    pixels: np.ndarray
    tags: dict[str, str]
    asked: list[int]

    @property
    def header(self) -> Header:
        rows, cols, bands = self.pixels.shape
        dtype = str(self.pixels.dtype)
        return Header(path="photo.tif", width=cols, height=rows, bands=bands, dtype=dtype, tags=self.tags)

    def read(self, window: Window) -> np.ndarray:
        self.asked.append(window.height * window.width)
        return self.pixels[window.slices]


def photograph(pixels: np.ndarray, **tags: str) -> InMemory:
    return InMemory(pixels if pixels.ndim == 3 else pixels[:, :, None], tags, [])


def texture(shape: tuple[int, int] = (80, 120)) -> np.ndarray:
    """Texture on the left, sky on the right."""
    image = 120 + 110 * gaussian_filter(np.random.default_rng(0).normal(size=shape), 1.2)
    image[:, 2 * shape[1] // 3 :] = 180
    return np.clip(image, 1, 255).astype(np.uint8)


def expected(image: np.ndarray, sizing: WindowSizing = SMALL) -> np.ndarray:
    return published_levels(size_map(grey_levels(image), Window(0, 0, *image.shape), sizing), sizing)


def drawn(found: PhotoMap) -> np.ndarray:
    picture = np.concatenate(list(found.strips))
    assert picture.shape == found.shape and picture.dtype == np.uint8
    return picture


@pytest.mark.parametrize("pixels_of_a_strip", [1, 120 * 33, 10**9])
def test_strips_of_any_height_make_the_map_of_the_whole(monkeypatch, pixels_of_a_strip):
    monkeypatch.setattr(window_size, "_STRIP", pixels_of_a_strip)
    photo = photograph(texture())
    assert np.array_equal(drawn(window_size_map(photo, SMALL)), expected(texture()))
    assert max(photo.asked) <= 120 * (max(16, pixels_of_a_strip // 120) + 2 * (SMALL.halves[-1] + 1))


@pytest.mark.parametrize("flag", range(1, 9))
def test_the_map_is_that_of_the_upright_photograph(flag):
    found = window_size_map(photograph(texture(), Orientation=str(flag)), SMALL)
    assert np.array_equal(drawn(found), expected(upright(texture(), flag)))


def test_sixteen_bits_give_nearly_the_map_of_their_eight_bits():
    wide = (texture().astype(np.uint16) - 1) * 16 + 700
    found = drawn(window_size_map(photograph(wide), SMALL))
    # Another contrast moves single pixels across the limit, so that only most of the map agrees.
    assert (found == expected(texture())).mean() > 0.85
    assert (found[:, 100:] == 255).all()


def test_the_legend_names_every_size_and_none():
    found = window_size_map(photograph(texture()), FoerstnerWindow(smallest=7, largest=13))
    assert found.labels == {0: "7 x 7", 63: "9 x 9", 127: "11 x 11", 191: "13 x 13", 255: "none"}
    assert set(np.unique(drawn(found))) <= set(found.labels)


@pytest.mark.parametrize("method", list(Method))
def test_the_notes_tell_the_limits_of_the_method(method):
    sizing = sizing_of(method, 15)
    notes = " ".join(window_size_map(photograph(texture()), sizing).notes)
    for kind in ("foerstner", "entropy") if method is Method.COMBINED else (method,):
        assert f"of the {kind} method is" in notes


def test_a_fixed_window_says_its_size():
    assert window_size_map(photograph(texture()), FixedWindow(window=9)).notes == ("Every window has 9 px.",)


@pytest.mark.parametrize("method", [Method.FOERSTNER, Method.ENTROPY, Method.COMBINED])
@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_share_of_the_pixels_gets_a_window(method, share):
    sizing = sizing_of(method, 15)
    found = window_size_map(photograph(texture((120, 150))), sizing, share)
    reach = sizing.halves[-1] + 1
    inner = drawn(found)[reach:-reach, reach:-reach]
    assert (inner < 255).mean() == pytest.approx(share, abs=0.05)
    assert f"{100 * share:.0f}" in found.notes[0]


def test_a_photograph_smaller_than_the_largest_window_is_refused():
    with pytest.raises(PhotoError, match=r"photo.tif has 120 x 80 px, too few for windows of 79 x 79 px; choose a smaller maximum"):
        window_size_map(photograph(texture()), FoerstnerWindow(largest=79))


def test_second_limits_are_those_of_the_method():
    assert sizing_of(Method.STATISTICAL, 21, second=30.0) == StatisticalWindow(largest=21, min_excess=30.0)
    assert sizing_of(Method.ENTROPY, 21, 4.5, 0.01) == EntropyWindow(largest=21, min_entropy=4.5, min_gain=0.01)
    assert sizing_of(Method.FOERSTNER, 21, second=0.7) == FoerstnerWindow(largest=21, min_roundness=0.7)
    with pytest.raises(WorkflowError, match=r"1\.5 cannot be the limit min_roundness of the foerstner method"):
        sizing_of(Method.FOERSTNER, 21, second=1.5)
    with pytest.raises(WorkflowError, match="combined method has two limits"):
        sizing_of(Method.COMBINED, 21, second=0.5)


def test_the_methods_are_sized_up_to_the_largest_and_take_a_limit():
    assert sizing_of(Method.STATISTICAL, 21, 30.0) == StatisticalWindow(largest=21, min_deviation=30.0)
    assert sizing_of(Method.ENTROPY, 21, 4.5) == EntropyWindow(largest=21, min_entropy=4.5)
    assert sizing_of(Method.FOERSTNER, 21, 900.0) == FoerstnerWindow(largest=21, min_weight=900.0)
    combined = sizing_of(Method.COMBINED, 21)
    assert isinstance(combined, CombinedWindow) and combined.halves[-1] == 10


def test_every_setting_of_a_window_in_a_workflow_can_be_given():
    entropy = sizing_of(Method.ENTROPY, 21, given=("smallest=9", "min_gain=0.02", "min_stalled = 2.5"))
    assert entropy == EntropyWindow(smallest=9, largest=21, min_gain=0.02, min_stalled=2.5)
    combined = sizing_of(Method.COMBINED, 35, given=("foerstner.min_roundness=0.7", "entropy.largest=25"))
    assert combined.foerstner.min_roundness == 0.7 and combined.entropy.largest == 25
    assert combined.foerstner.largest == 35 and combined.entropy.min_entropy == CombinedWindow().entropy.min_entropy
    for method in (Method.STATISTICAL, Method.ENTROPY, Method.FOERSTNER):
        plain = sizing_of(method, 35)
        names = set(type(plain).model_fields) - {"kind"}
        known = {**plain.model_dump(), "min_gain": 0.1}
        assert all(sizing_of(method, 35, given=("min_gain=0.1",) * ("min_gain" in names) + (f"{n}={known[n]}",)) for n in names)


@pytest.mark.parametrize("words", ["min_gain", "kind=entropy", "largest.min_gain=2", "min_weight=300", "foerstner.min_weight=3"])
def test_a_setting_that_the_method_does_not_have_is_refused_with_those_that_it_has(words):
    with pytest.raises(WorkflowError, match=rf"{words} is no setting of the entropy method; .* smallest, largest, min_entropy"):
        sizing_of(Method.ENTROPY, 21, given=(words,))


@pytest.mark.parametrize("words", ["smallest=99", "min_entropy=7", "min_entropy=much", "min_stalled=2"])
def test_a_value_that_cannot_be_is_refused(words):
    with pytest.raises(WorkflowError, match=rf"{words} is not possible with the entropy method: "):
        sizing_of(Method.ENTROPY, 21, given=(words,))


def test_limits_that_a_method_cannot_have_are_refused():
    with pytest.raises(WorkflowError, match="two limits, so a single one cannot be given"):
        sizing_of(Method.COMBINED, 21, 4.0)
    with pytest.raises(WorkflowError, match="7 cannot be the limit min_entropy of the entropy method"):
        sizing_of(Method.ENTROPY, 21, 7.0)


def test_a_share_is_given_alone_and_between_0_and_100_per_cent():
    assert share_of(None, 5.0) is None and share_of(40.0, None) == pytest.approx(0.4) and share_of(100.0, None) == 1.0
    with pytest.raises(WorkflowError, match="not both; leave one out"):
        share_of(40.0, 5.0)


@settings(max_examples=30, deadline=None)
@given(st.one_of(st.floats(max_value=0.0), st.floats(min_value=100.0, exclude_min=True), st.just(float("nan"))))
def test_impossible_shares_are_refused(assigned):
    with pytest.raises(WorkflowError, match="more than 0 and at most 100"):
        share_of(assigned, None)
