"""The interior orientation of a camera, its lens, and their precision.

Photogrammetric convention: origin at the principal point, x right, y up, in pixels; the camera looks along -z. `x0`, `y0` are the
principal point relative to the image centre ((width - 1) / 2, (height - 1) / 2), y up. Lens models have OpenCV's coefficients: the
radius is in units of c, and the distortion is added to the ideal point to give the observed one. x is then scaled by 1 + affinity
and sheared by skew: c is the camera constant along y, c (1 + affinity) that along x.
"""

from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from orthomill.schemas.job import Table

# Rows of stored covariances carry no names: another order would silently exchange them in existing projects. Those of the first
# eight, which is all that earlier versions knew, are read with zeros for the others.
InteriorParameter = Literal[
    "c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "affinity", "skew", "k4", "k5", "k6", "s1", "s2", "s3", "s4"
]  # fmt: skip
INTERIOR: tuple[str, ...] = get_args(InteriorParameter)
"""Order of the interior parameters of all lens models in every covariance and every kernel; a model has some of them."""


class _LensModel(BaseModel):
    # Closed, because camera files are also written by hand: a misspelt k1 must not pass as a lens without distortion.
    model_config = ConfigDict(frozen=True, extra="forbid")

    # First in every file: a reader wants to know the model before its coefficients.
    kind: str


class _Polynomial(_LensModel):
    """What Brown's model and all that extend it have."""

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0


class _Quotient(_Polynomial):
    """The denominator of rational models."""

    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0


class BrownLens(_Polynomial):
    """Polynomial in the radius, and decentring: most lenses."""

    kind: Literal["brown"] = "brown"


class RationalLens(_Quotient):
    """Quotient of two polynomials (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6), and decentring: wide lenses."""

    kind: Literal["rational"] = "rational"


class ThinPrismLens(_Quotient):
    """The rational model with the terms of a tilted element, s1 r^2 + s2 r^4 along x and s3 r^2 + s4 r^4 along y (downwards)."""

    kind: Literal["thin_prism"] = "thin_prism"
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0


class FisheyeLens(_LensModel):
    """Kannala and Brandt's t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) of the angle t to the axis; equidistant with all of them 0."""

    kind: Literal["fisheye"] = "fisheye"
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0


class DivisionLens(_LensModel):
    """Ideal radius r / (1 + k1 r^2) of the observed radius r: wide lenses by one coefficient."""

    kind: Literal["division"] = "division"
    k1: float = 0.0


_AnyLens = BrownLens | RationalLens | ThinPrismLens | FisheyeLens | DivisionLens
Lens = Annotated[_AnyLens, Field(discriminator="kind")]
LensKind = Literal["brown", "rational", "thin_prism", "fisheye", "division"]
LENSES: dict[str, type[_AnyLens]] = {model.model_fields["kind"].default: model for model in get_args(_AnyLens)}
"""The lens models by their kind."""


def lens_parameters(kind: str) -> tuple[str, ...]:
    """The interior parameters of a camera with this kind of lens, in the order of INTERIOR."""
    own = {"c", "x0", "y0", "affinity", "skew", *LENSES[kind].model_fields}
    return tuple(name for name in INTERIOR if name in own)


class Camera(BaseModel):
    """One camera: image size, interior orientation and its precision."""

    # Closed for the same reason as the lenses.
    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    width: int = Field(gt=0, description="px")
    height: int = Field(gt=0, description="px")
    # In pixels, because EXIF states the size of the sensor only roughly or not at all, and the adjustment does not need it.
    c: float = Field(gt=0, description="camera constant along y, px")
    x0: float = 0.0
    y0: float = 0.0
    lens: Lens = BrownLens()
    affinity: float = 0.0
    """x is scaled by 1 + affinity relative to y: pixels that are not square"""
    skew: float = 0.0
    """x grows by skew * y: axes that are not perpendicular"""
    pixel_um: float | None = None
    """Side of a pixel on the sensor or scan in micrometres, where it is known."""
    source: Literal["file", "exif", "chessboards", "given", "block", "truth"] = "given"
    sigma0: float | None = None
    # The whole matrix: x0 and p2, y0 and p1, c and k1 compensate each other, so that propagating their standard errors alone would
    # misstate the errors of image rays.
    covariance: tuple[tuple[float, ...], ...] | None = None
    """17 x 17 in the order of INTERIOR; zero rows for parameters fixed beyond doubt or that the lens lacks. None: not known."""

    @model_validator(mode="before")
    @classmethod
    def _flat_coefficients(cls, values: Any) -> Any:
        """Coefficients beside c, as camera files of earlier versions have them, are those of Brown's model."""
        if not isinstance(values, dict) or "lens" in values:
            return values
        flat = {name: value for name, value in values.items() if name in BrownLens.model_fields and name != "kind"}
        return {**{name: value for name, value in values.items() if name not in flat}, "lens": {"kind": "brown", **flat}}

    @field_validator("covariance")
    @classmethod
    def _all_parameters(cls, value: tuple[tuple[float, ...], ...] | None) -> tuple[tuple[float, ...], ...] | None:
        """The covariance of the first eight parameters with zeros for the others."""
        # Only what earlier versions wrote: any other size is a mistake, and is named where the file is read.
        return padded(value) if value is not None and {len(value), *map(len, value)} == {_FORMER} else value

    # As a tuple in one fixed order: covariances and kernels address parameters by index.
    @property
    def interior(self) -> tuple[float, ...]:
        """The interior parameters in the order of INTERIOR; 0 for those that the lens lacks."""
        own = vars(self) | vars(self.lens)
        return tuple(own.get(name, 0.0) for name in INTERIOR)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The interior parameters that the lens has, in the order of INTERIOR; affinity and skew only where they are not 0 or were
        estimated."""
        variance = np.zeros(len(INTERIOR)) if self.covariance is None else np.diag(np.array(padded(self.covariance)))
        square = {name for name in ("affinity", "skew") if not getattr(self, name) and not variance[INTERIOR.index(name)] > 0}
        return tuple(name for name in lens_parameters(self.lens.kind) if name not in square)

    def value(self, parameter: str) -> float:
        """An interior parameter by its name; 0 where the lens lacks it."""
        return self.interior[INTERIOR.index(parameter)]

    def changed(self, **values: float) -> "Camera":
        """The camera with other interior parameters, by name. Raises ValueError for one that its lens lacks."""
        own = {name: value for name, value in values.items() if name in _OWN}
        lens = {name: value for name, value in values.items() if name not in _OWN}
        if missing := [name for name in lens if name not in type(self.lens).model_fields]:
            raise ValueError(f"a lens of kind {self.lens.kind} has no {', '.join(missing)}")
        return self.model_copy(update={**own, "lens": self.lens.model_copy(update=lens)})

    def with_interior(self, values: np.ndarray) -> "Camera":
        """The camera with other interior parameters (17,) in the order of INTERIOR; those that its lens lacks are passed over."""
        named = dict(zip(INTERIOR, map(float, values), strict=False))
        return self.changed(**{name: named[name] for name in lens_parameters(self.lens.kind) if name in named})


_OWN = ("c", "x0", "y0", "affinity", "skew")
"""The interior parameters that are not those of the lens."""


_FORMER = 8
"""The number of interior parameters that earlier versions knew."""


def padded(covariance: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """A covariance with the interior parameters of earlier versions as columns, and as rows where there are as many, with zeros for
    the others; as it is where it has all."""
    more = len(INTERIOR) - _FORMER
    if any(len(row) != _FORMER for row in covariance):
        return covariance
    rows = tuple((*row, *(0.0,) * more) for row in covariance)
    return rows + ((0.0,) * len(INTERIOR),) * (more * (len(rows) == _FORMER))


class Cameras(BaseModel):
    """All cameras of a project, and the camera of each photograph."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # By name: photographs with the same camera share one set of unknowns in the adjustment, which equal copies would not express.
    cameras: dict[str, Camera]
    of_photo: dict[str, str]

    def of(self, photo: str) -> Camera:
        """The camera of a photograph."""
        return self.cameras[self.of_photo[photo]]

    def with_k1(self, k1: dict[str, float]) -> "Cameras":
        """A copy with new values of `k1`, given by camera name."""
        # The covariance remains as it is: an approximate k1 only starts the adjustment, it is not an estimate.
        changed = {name: self.cameras[name].changed(k1=value) for name, value in k1.items()}
        return self.model_copy(update={"cameras": {**self.cameras, **changed}})


CAMERAS = Table("calibration/cameras.json", Cameras)
