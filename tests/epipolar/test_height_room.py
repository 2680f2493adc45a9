"""How far above the tie points a pair must see: the share of the flying height, or the room for crowns, never up to the camera."""

import pytest
from tiny_block import block

from orthomill.tasks.epipolar.selection import block_heights


@pytest.mark.parametrize(("margin", "room", "spare"), [(0.1, 0.0, 0.1), (0.1, 1e9, 0.35), (0.1, 0.2, 0.2), (0.1, 0.05, 0.1)])
def test_room_is_added_upwards_only(margin, room, spare):
    known = block()
    flying = sum(photo.centre[2] for photo in known.photos) / len(known.photos) - (known.ground_low + known.ground_high) / 2
    heights = block_heights(known, margin, room if room > 1 else room * flying)
    assert heights.low == pytest.approx(known.ground_low - margin * flying)
    assert heights.high == pytest.approx(known.ground_high + spare * flying)
