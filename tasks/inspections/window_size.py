"""The map of matching window sizes of a photograph: which window would be used where, and where none.

Strategy: the photograph is read in strips with a halo, upright and as grey values of 8 bits, as in matching. Where a share of the
pixels is to get a window, a first pass finds the limit on a regular grid of pixels; pixels so close to the border that the largest
window does not fit are excluded from that share.

Source: Skarlatos (sources/matching.md#size-map).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.inspections.inspection import PhotoFile, PhotoMap
from orthomill.schemas.inspections.window_method import Method
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.radiometry import grey_bytes, grey_range
from orthomill.tasks.imagery.upright import exif_orientation, file_window, upright, upright_shape
from orthomill.tasks.matching.windows.calibration import LIMITS, LimitCalibration, calibrated, last_limits
from orthomill.tasks.matching.windows.size_map import halo, published_levels, size_map
from orthomill.tasks.matching.windows.sizes import GreyLevels, grey_levels
from orthomill.tasks.matching.windows.window_settings import (
    CombinedWindow,
    EntropyWindow,
    FixedWindow,
    FoerstnerWindow,
    StatisticalWindow,
    WindowSizing,
)

_STRIP = 2_000_000
"""pixels of a strip"""
_LEAST_ROWS = 16
"""rows of a strip, so that its halo does not dominate"""
_SAMPLES = 200
"""points of the calibrating grid along the shorter side"""
_OVERVIEW = 512
"""pixels along the longer side from which the range of 16-bit photographs is found"""


_METHODS: dict[Method, type[StatisticalWindow] | type[EntropyWindow] | type[FoerstnerWindow]] = {
    Method.STATISTICAL: StatisticalWindow,
    Method.ENTROPY: EntropyWindow,
    Method.FOERSTNER: FoerstnerWindow,
}


_SECOND = {StatisticalWindow: "min_excess", EntropyWindow: "min_gain", FoerstnerWindow: "min_roundness"}
"""the second limit of each method; the first ones are those that a share can find (LIMITS)"""


def sizing_of(
    method: Method, largest: int, limit: float | None = None, second: float | None = None, given: Sequence[str] = ()
) -> WindowSizing:
    """The sizing of a method up to windows of `largest` px, with its defaults, with another `limit`, or with another `second` one:
    the excess of the statistical method, the gain of the entropy, the roundness of Foerstner's.

    given: any other settings of a workflow's `window`, as `min_stalled=2.5`; `entropy.min_gain=0.01` for a part of the combined
    method. Raises WorkflowError for a limit or a setting that the method cannot have.
    """
    sizing = _limited(method, largest, limit, second)
    for words in given:
        sizing = _with_setting(sizing, method, words)
    return sizing


def _limited(method: Method, largest: int, limit: float | None, second: float | None) -> WindowSizing:
    if method is Method.COMBINED:
        if limit is not None or second is not None:
            raise WorkflowError("The combined method has two limits, so a single one cannot be given; give a share (assigned).")
        parts = CombinedWindow()
        return CombinedWindow(
            foerstner=parts.foerstner.model_copy(update={"largest": largest}),
            entropy=parts.entropy.model_copy(update={"largest": largest}),
        )
    kind = _METHODS[method]
    sizing: WindowSizing = kind(largest=largest)
    # One after the other, so that the sentence names the one that is out of bounds.
    for name, value in ((LIMITS[kind], limit), (_SECOND[kind], second)):
        if value is not None:
            sizing = _with_limit(sizing, method, name, value)
    return sizing


def _with_limit(sizing: WindowSizing, method: Method, name: str, value: float) -> WindowSizing:
    try:
        # Validated again as a whole: `model_copy` would accept a limit out of bounds.
        return type(sizing).model_validate({**sizing.model_dump(), name: value})
    except ValidationError as error:
        reason = error.errors()[0]["msg"]
        raise WorkflowError(f"{value:g} cannot be the limit {name} of the {method} method: {reason}.") from error


def _with_setting(sizing: WindowSizing, method: Method, words: str) -> WindowSizing:
    """The sizing with a setting `name=value`, or `part.name=value`."""
    name, equals, value = words.partition("=")
    *parts, last = name.strip().split(".")
    whole: dict[str, Any] = sizing.model_dump()
    inner = whole
    for part in parts:
        below = inner.get(part)
        inner = below if isinstance(below, dict) else {}
    if not equals or last not in inner or isinstance(inner[last], dict) or last == "kind":
        names = ", ".join(_setting_names(sizing))
        raise WorkflowError(f"{words} is no setting of the {method} method; write name=value, with a name of: {names}.")
    inner[last] = value.strip()
    try:
        return type(sizing).model_validate(whole)
    except ValidationError as error:
        raise WorkflowError(f"{words} is not possible with the {method} method: {error.errors()[0]['msg']}.") from error


def _setting_names(sizing: WindowSizing) -> Iterator[str]:
    for name, value in sizing.model_dump().items():
        if isinstance(value, dict):
            yield from (f"{name}.{inner}" for inner in value if inner != "kind")
        elif name != "kind":
            yield name


@dataclass(frozen=True)
class _Upright:
    """A photograph in upright strips of grey levels."""

    file: PhotoFile
    limits: tuple[float, float] = (0.0, 255.0)

    @property
    def flag(self) -> int:
        return exif_orientation(self.file.header.tags)

    @property
    def shape(self) -> tuple[int, int]:
        return upright_shape(self.flag, self.file.header.height, self.file.header.width)

    def strips(self) -> Iterator[Window]:
        rows, cols = self.shape
        # A strip is as many rows as memory allows, whatever the width of the photograph.
        height = max(_LEAST_ROWS, _STRIP // cols)
        for row in range(0, rows, height):
            yield Window(row, 0, min(height, rows - row), cols)

    def pixels(self, window: Window) -> np.ndarray:
        header = self.file.header
        return upright(self.file.read(file_window(window, self.flag, header.height, header.width)), self.flag)

    def levels(self, strip: Window, reach: int) -> tuple[GreyLevels, Window]:
        """Grey levels of a strip with `reach` px around it, and where in them the strip lies."""
        read = strip.grown(reach).clipped(self.shape)
        core = strip.within(read)
        return grey_levels(grey_bytes(self.pixels(read), self.limits)), core

    def stretched(self) -> "_Upright":
        """The same photograph with the grey values that become 0 and 255, which 16 bits need."""
        if self.file.header.dtype == "uint8":
            return self
        every = -(-max(self.shape) // _OVERVIEW)
        # Rows are counted from the top of the photograph, so that the sample does not depend on the strips.
        parts = [self.pixels(strip)[-strip.row % every :: every, ::every] for strip in self.strips()]
        return _Upright(self.file, grey_range(np.concatenate(parts)))


def window_size_map(file: PhotoFile, sizing: WindowSizing, share: float | None = None) -> PhotoMap:
    """The map of window sizes as `published_levels`; with `share` (0 to 1), the limit is calibrated to that share of the pixels.

    Raises PhotoError for a photograph that holds no window of the largest size, or that cannot be decoded.
    """
    photo = _Upright(file)
    side = 2 * sizing.halves[-1] + 1
    if min(photo.shape) < side + 2:
        size = f"{photo.shape[1]} x {photo.shape[0]} px"
        raise PhotoError(f"{file.header.path} has {size}, too few for windows of {side} x {side} px; choose a smaller maximum.")
    photo = photo.stretched()
    notes: tuple[str, ...] = ()
    if share is not None:
        found = _calibrated(photo, sizing, share)
        # The limit that was found is part of the result: the next photograph can be inspected with it.
        sizing, notes = found.sizing, (_share_sentence(found),)
    labels = dict(
        zip(
            (int(level) for level in published_levels(np.array(sizing.halves), sizing)),
            (f"{2 * half + 1} x {2 * half + 1}" for half in sizing.halves),
            strict=True,
        )
    )
    return PhotoMap(photo.shape, _strips(photo, sizing), {**labels, 255: "none"}, (*notes, _limit_sentence(sizing)))


def _strips(photo: _Upright, sizing: WindowSizing) -> Iterator[np.ndarray]:
    for strip in photo.strips():
        yield published_levels(size_map(*photo.levels(strip, halo(sizing)), sizing), sizing)


def _calibrated(photo: _Upright, sizing: WindowSizing, share: float) -> LimitCalibration:
    # Near the border a window fails for lack of room, which no limit can change.
    reach = halo(sizing)
    # A grid of 200 points along the shorter side fixes a share to a fraction of a per cent.
    step = max(1, min(photo.shape) // _SAMPLES)
    rows, cols = (np.arange(reach, side - reach, step) for side in photo.shape)
    found = []
    for strip in photo.strips():
        image, core = photo.levels(strip, reach)
        inside = rows[(rows >= strip.row) & (rows < strip.row + strip.height)] - strip.row + core.row
        found.append(last_limits(image, np.column_stack([np.tile(cols, len(inside)), np.repeat(inside, len(cols))]), sizing))
    return calibrated(sizing, np.concatenate(found), share)


def _share_sentence(found: LimitCalibration) -> str:
    return f"The limit gives a window to {100 * found.share:.1f} % of the pixels that lie away from the border."


def _limit_sentence(sizing: WindowSizing) -> str:
    if isinstance(sizing, CombinedWindow):
        return f"{_limit_sentence(sizing.foerstner)} {_limit_sentence(sizing.entropy)}"
    if isinstance(sizing, FixedWindow):
        return f"Every window has {sizing.window} px."
    field = LIMITS[type(sizing)]
    extra = type(sizing).model_fields[field].json_schema_extra
    unit = str(extra["unit"]) if isinstance(extra, dict) else ""
    return f"{field} of the {sizing.kind} method is {getattr(sizing, field):.5g} {unit}."


def share_of(assigned: float | None, limit: float | None) -> float | None:
    """A share (0 to 1) from per cent. Raises WorkflowError when a limit is given as well, or it is not between 0 and 100."""
    if assigned is None:
        return None
    if limit is not None:
        raise WorkflowError("Either a limit or the share of pixels with a window can be given, not both; leave one out.")
    if not (math.isfinite(assigned) and 0.0 < assigned <= 100.0):
        raise WorkflowError(f"{assigned:g} % of the pixels cannot be given a window; say more than 0 and at most 100.")
    return assigned / 100.0
