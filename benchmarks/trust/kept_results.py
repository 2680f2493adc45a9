"""What a run keeps, in a folder or an object store, by its digests."""

import hashlib

from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.store import Store


def kept(depot: Depot) -> dict[str, str]:
    """Digest of every raster's pixels, and of the bytes of every table and product."""
    store = Store(depot)
    found = {name: hashlib.sha256(store.read(name, store.spec(name).full).tobytes()).hexdigest() for name in store.names()}
    files = [name for part in ("tables", "products") for name in depot.names(part)]
    return found | {name: hashlib.sha256(depot.get(name)).hexdigest() for name in files}
