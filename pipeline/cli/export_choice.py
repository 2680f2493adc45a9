"""Which exports `orthomill export` makes: one raster of the store, or all products whose inputs are there."""

from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.export.file_parts import parts_of
from orthomill.pipeline.storage.depots.folder import PRODUCTS
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Export


def chosen_exports(session: Session, raster: str | None, path: str | None) -> list[Export]:
    """One raster as a GeoTIFF, or with none named all products and the parts that they are made of. Raises StoreError where there
    is nothing to export."""
    if raster is not None:
        session.store.spec(raster)  # raises for a raster that does not exist, before the lock is taken
        target = path or f"products/{raster.replace('/', '_')}.tif"
        return [Export("export", raster, target, "cog", rasters={"value": raster})]
    # Only products whose inputs exist: after an interrupted run the others are still to be computed.
    session.plan()
    places = (f"{PRODUCTS}/", parts_of(f"{PRODUCTS}/"))
    planned = [p.job for p in session.graph.jobs.values() if isinstance(p.job, Export) and p.job.path.startswith(places)]
    store = session.store
    ready = [
        job
        for job in planned
        if all(map(store.has, job.rasters.values())) and all(map(store.has_table, (*job.tables, *job.beside)))
    ]
    if not ready:
        raise StoreError(f"{session.folder.name} has no products yet; run it first: orthomill run {session.folder.name}")
    return ready
