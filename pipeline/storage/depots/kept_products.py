"""The products of a run where they are kept: listed and read there, and copied one by one for libraries that open files.

Beside them count files that lie in products/ of the run's folder alone, such as those that `orthomill export --as` makes.
"""

import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path, PurePosixPath

from orthomill.pipeline.storage.depots.folder import PRODUCTS, Folder
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.depots.product_files import JOINED, SHEETS, WHOLE, other_form, raster_products, sheet_folder
from orthomill.pipeline.storage.whole_files import replacing


class KeptProducts:
    """Those of the run in `folder`, by their names in it: products/ortho.tif."""

    def __init__(self, folder: Path) -> None:
        self._here, self._depot = Folder(folder), depot_of(folder)

    @cached_property
    def _kept(self) -> frozenset[str]:
        return frozenset(self._depot.names(PRODUCTS))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All of them, those in folders as well, sorted."""
        own = self._kept if self._here == self._depot else frozenset(self._here.names(PRODUCTS))
        return tuple(sorted(self._kept | {name for name in own if not self._is_former(name)}))

    def _is_former(self, name: str) -> bool:
        """Whether a file here is a copy of what a kept product was before: in one file or in sheets, or in more sheets."""
        folder = str(PurePosixPath(name).parent)
        product = folder.removesuffix(SHEETS) if folder.endswith(SHEETS) else None
        others = {f"{product}{WHOLE}", f"{product}{JOINED}"} if product else {other_form(name)}
        return name not in self._kept and not self._kept.isdisjoint(others)

    @property
    def rasters(self) -> dict[str, str]:
        """Raster products by what people call them: ortho -> products/ortho.tif or products/ortho.vrt."""
        found = raster_products(name.removeprefix(f"{PRODUCTS}/") for name in self.names if name.count("/") == 1)
        return {name: f"{PRODUCTS}/{file}" for name, file in sorted(found.items())}

    def here(self, name: str) -> Path | None:
        """The path of a file that lies in the run's folder; None where it is kept elsewhere."""
        return self._here.path / name if self._here == self._depot or name not in self._kept else None

    def size(self, name: str) -> int:
        """Bytes of a file. Raises FileNotFoundError."""
        found = (self._depot if name in self._kept else self._here).state(name)
        if found is None:
            raise FileNotFoundError(name)
        return found.size

    def blocks(self, name: str) -> Iterator[bytes]:
        """A file of the run in pieces, read where it is kept: products, and pages in its folder. Raises OSError, StoreError."""
        return (self._depot if name in self._kept else self._here).blocks(name)

    def opened(self, name: str) -> AbstractContextManager[Path]:
        """A path of a file for libraries that read by path; gone afterwards where it is kept elsewhere. Raises OSError,
        StoreError."""
        return (self._depot if name in self._kept else self._here).local(name)

    def brought(self, name: str) -> Path:
        """The path of a product, or of a folder of products, in the run's folder, with its sheets and what lies beside it; copied
        from where it is kept. Raises OSError, StoreError."""
        if self._here != self._depot:
            for one in sorted(self._kept):
                if one == name or one.startswith((f"{name}/", f"{name}.", f"{sheet_folder(name)}/")):
                    self._copy(one)
            # A copy of what the product was before, in sheets or not, would be taken for it.
            if name.endswith((WHOLE, JOINED)) and (before := other_form(name)) not in self._kept:
                (self._here.path / before).unlink(missing_ok=True)
        return self._here.path / name

    def _copy(self, name: str) -> None:
        with self._depot.local(name) as copy, replacing(self._here.path / name) as target, copy.open("rb") as source:
            shutil.copyfileobj(source, target)

    def raster(self, name: str) -> Path | None:
        """The path of the raster product that people call so, brought here; None where there is none. Raises OSError,
        StoreError."""
        found = self.rasters.get(name)
        return self.brought(found) if found else None
