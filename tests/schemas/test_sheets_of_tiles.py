"""Sheets of whole tiles."""

import pytest

from orthomill.schemas.raster import sheets_of, tiles_in, tiles_of

CASES = [((1000, 700), 64, 256), ((130, 130), 64, 32), ((512, 512), 512, 4096), ((65, 1), 64, 64)]


@pytest.mark.parametrize(("shape", "size", "side"), CASES)
def test_sheets_hold_every_tile_once(shape, size, side):
    tiles = list(tiles_of(shape, size))
    held = [list(tiles_in(sheet, shape, size)) for sheet in sheets_of(shape, size, side)]
    assert sorted((tile for part in held for tile in part), key=lambda tile: (tile.row, tile.col)) == tiles
    for sheet, part in zip(sheets_of(shape, size, side), held, strict=True):
        rows, cols = (range(a, a + b) for a, b in ((sheet.window.row, sheet.window.height), (sheet.window.col, sheet.window.width)))
        assert part == [tile for tile in tiles if tile.window.row in rows and tile.window.col in cols]
