"""Lists of points that commands are given, in any letters; what is no text is one sentence."""

import pytest

from orthomill.pipeline.cli.point_lists import point_list
from orthomill.schemas.errors import StoreError

TEXT = "name,x,y,z\nGrößé,1,2,3\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_names_keep_their_letters(tmp_path, encoding):
    path = tmp_path / "points.csv"
    path.write_bytes(TEXT.encode(encoding))
    assert point_list(path, "EPSG:32632") == (TEXT, "EPSG:32632")


def test_a_picture_is_no_list(tmp_path):
    path = tmp_path / "points.csv"
    path.write_bytes(bytes(range(256)) * 20)
    with pytest.raises(StoreError, match="no text"):
        point_list(path, None)
