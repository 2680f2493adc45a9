"""Products are read where they are kept, and copied only as far as a library opens them."""

import os

import pytest

pytest.importorskip("obstore")

from orthomill.pipeline.storage.depots.kept_at import depot_of, keep_in
from orthomill.pipeline.storage.depots.kept_products import KeptProducts


def test_products_in_a_bucket_are_listed_and_read_there_and_only_what_is_asked_for_is_copied(tmp_path):
    run, contents = tmp_path / "runs/site", {}
    keep_in(run, f"memory://{os.urandom(4).hex()}")
    for name in ("ortho.vrt", "ortho_sheets/0-0.tif", "dsm.tif", "dsm.tif.aux.xml", "points/0.laz", "points/1.laz"):
        contents[f"products/{name}"] = name.encode()
        depot_of(run).put(f"products/{name}", name.encode())
    (run / "products/exported").mkdir(parents=True)
    (run / "products/exported/a.png").write_bytes(b"made here")
    (run / "products/ortho.tif").write_bytes(b"of an earlier run")
    products = KeptProducts(run)
    assert products.names == tuple(sorted([*contents, "products/exported/a.png"]))
    assert products.rasters == {"dsm": "products/dsm.tif", "ortho": "products/ortho.vrt"}
    assert {name: b"".join(products.blocks(name)) for name in contents} == contents
    assert b"".join(products.blocks("products/exported/a.png")) == b"made here" and products.size("products/dsm.tif") == 7
    assert products.here("products/dsm.tif") is None and products.here("products/exported/a.png")

    def copied() -> set[str]:
        return {path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file()} & contents.keys()

    assert not copied() and products.raster("dsm") == run / "products/dsm.tif" and products.raster("terrain") is None
    assert copied() == {"products/dsm.tif", "products/dsm.tif.aux.xml"}
    products.raster("ortho")
    assert copied() >= {"products/ortho.vrt", "products/ortho_sheets/0-0.tif"} and not (run / "products/ortho.tif").exists()
    products.brought("products/points")
    assert copied() == set(contents)
