"""Point clouds as points of known height: their place, their heights in metres, and the standard errors that they state."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr
from pyproj import CRS, Transformer

from orthomill.pipeline.storage.cloud_files import read_cloud
from orthomill.schemas.errors import WorkflowError

HERE = "EPSG:32634"
X, Y, Z = (
    np.array([500_000.0, 500_010.0, 500_020.0]),
    np.array([4_000_000.0, 4_000_005.0, 4_000_010.0]),
    np.array([12.0, 13.0, 14.0]),
)
FOOT = 1200 / 3937


def written(path: Path, crs: str | None, xyz: tuple[np.ndarray, ...], sigma: tuple[str, np.ndarray] | None = None) -> Path:
    """A point cloud whose last point is noise."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = [1e-4] * 3, [np.floor(axis[0]) for axis in xyz]
    if sigma:
        header.add_extra_dim(laspy.ExtraBytesParams(sigma[0], "f4"))
    if crs:
        header.vlrs.append(WktCoordinateSystemVlr(CRS.from_user_input(crs).to_wkt()))
        header.global_encoding.wkt = True
    points = laspy.ScaleAwarePointRecord.zeros(len(xyz[0]), header=header)
    points.x, points.y, points.z = xyz
    points.classification[-1] = 7
    if sigma:
        points[sigma[0]] = sigma[1]
    with laspy.open(path, "w", header=header, laz_backend=laspy.LazBackend.Lazrs) as target:
        target.write_points(points)
    return path


@pytest.mark.parametrize("crs", [HERE, None], ids=["named", "not named"])
def test_points_without_noise_and_without_standard_errors(tmp_path, crs):
    found = read_cloud(written(tmp_path / "a.laz", crs, (X, Y, Z)), HERE)
    assert found.x == pytest.approx(X[:2]) and found.y == pytest.approx(Y[:2]) and found.z == pytest.approx(Z[:2])
    assert np.isnan(found.sigma).all()


@pytest.mark.parametrize("name", ["sigma_z", "Sigma Z", "precision"])
def test_standard_errors_stand_in_an_attribute(tmp_path, name):
    path = written(tmp_path / "a.las", HERE, (X, Y, Z), (name, np.array([0.04, 0.0, 0.05])))
    assert read_cloud(path, HERE).sigma == pytest.approx([0.04, np.nan], nan_ok=True), "0 says that none is known"


def test_feet_and_other_systems_become_metres_in_that_of_the_project(tmp_path):
    x, y = Transformer.from_crs(HERE, "EPSG:32635", always_xy=True).transform(X, Y)
    path = written(tmp_path / "a.laz", "EPSG:32635+6360", (x, y, Z / FOOT), ("sigma_z", np.full(3, 0.1 / FOOT)))
    found = read_cloud(path, HERE)
    assert found.x == pytest.approx(X[:2], abs=1e-3) and found.y == pytest.approx(Y[:2], abs=1e-3)
    assert found.z == pytest.approx(Z[:2], abs=1e-3) and found.sigma == pytest.approx([0.1, 0.1])


def test_files_that_are_none_are_named(tmp_path):
    (tmp_path / "a.laz").write_bytes(b"no points")
    with pytest.raises(WorkflowError, match=r"a\.laz is not a LAS or LAZ file"):
        read_cloud(tmp_path / "a.laz", HERE)
