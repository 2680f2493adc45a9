"""OpenSfM's ground_control_points.json, with points and their measurements.

`{"points": [{"id", "role", "position": {"latitude", "longitude", "altitude"}, "observations": [{"shot_id", "projection": [x, y]}]}
]}`; projections are from the centre of the photograph, in units of its longer side. Source: OpenSfM's documentation, "Ground
control points".
"""

import json
import math
from typing import Any

from orthomill.schemas.photo import Photos
from orthomill.schemas.survey_files.photograph_names import PhotographNames
from orthomill.tasks.orientation.control.control_rows import Row, Rows, StatedControl, stated_row

_FORM = "ground_control_points.json of OpenSfM"
_ROLES = {"optimization": "control", "metrics_only": "check"}


def is_opensfm(text: str) -> bool:
    """Whether a text is such a file."""
    return text.lstrip().startswith("{") and '"points"' in text and '"observations"' in text


def opensfm_rows(text: str, photos: Photos, stated: StatedControl, mistakes: list[str]) -> tuple[Rows, Rows]:
    """Points and measurements, in pixels of the files of `photos`; what is wrong is added to `mistakes`."""
    points: list[Row] = []
    marks: list[Row] = []
    names, system = PhotographNames(photos.names), "EPSG:4326"
    try:
        found = json.loads(text)
        system = found.get("crs") or system
        for number, point in enumerate(found["points"], 1):
            name = str(point["id"])
            points.append((number, _point(name, point, stated)))
            for seen in point["observations"]:
                photo = names.find(str(seen["shot_id"])) or str(seen["shot_id"])
                col, row = _pixel(seen["projection"], photos, photo)
                own = {"name": name, "photo": photo, "col": repr(col), "row": repr(row), "sigma": repr(stated.sigma_px)}
                marks.append((number, own))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        mistakes.append(
            f"The control file is no {_FORM} that can be read ({type(error).__name__}: {error}); its points need id, position and "
            "observations."
        )
    return Rows(_FORM, tuple(points), system), Rows(_FORM, tuple(marks))


def _point(name: str, point: dict[str, Any], stated: StatedControl) -> dict[str, str]:
    place = point.get("position") or {}
    x, y = (place.get(word, place.get(other)) for word, other in (("longitude", "x"), ("latitude", "y")))
    z = place.get("altitude", place.get("z"))
    own = stated_row(name, {"x": str(x), "y": str(y), "z": "nan" if z is None else str(z)}, stated)
    role = _ROLES.get(str(point.get("role")), own["role"])
    # Points without a position are tie points.
    return own | {"role": "tie" if not place else "check" if own["role"] == "check" else role}


def _pixel(projection: list[float], photos: Photos, photo: str) -> tuple[float, float]:
    """Column and row of a projection; NaN in photographs that the project does not have."""
    if photo not in photos.names:
        return 0.0, 0.0
    own = photos[photo]
    size = max(own.width, own.height)
    col, row = float(projection[0]) * size + own.width / 2 - 0.5, float(projection[1]) * size + own.height / 2 - 0.5
    return (col, row) if math.isfinite(col + row) else (math.nan, math.nan)
