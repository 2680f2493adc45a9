"""Tables on disk: pydantic models as readable JSON, columns as parquet. A write is complete or absent.

A table that consists of bytes only (descriptors, patches, whole files) has binary values in its file: parquet has no 8-bit type and
would store each byte as a 32-bit integer, which costs more to read than everything that is done with it afterwards.
"""

from dataclasses import fields
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic_core import to_json

from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.sealed_json import seal, unsealed
from orthomill.pipeline.storage.tables.arrow_columns import arrow_of, arrow_of_bytes, numpy_of
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Columns, Table

_PIECES = 16
"""binary values that are packed together"""


def write_table(depot: Depot, name: str, value: Any) -> None:
    """Store a pydantic model (.json) or a `Columns` (.parquet) under a name. Raises StoreError."""
    try:
        _write(depot, name, value)
    except OSError as error:
        raise StoreError(
            f"{depot.address}/{name} cannot be written: {error.strerror}; make room on the disk or make the folder "
            "writable, then run again."
        ) from error


def _write(depot: Depot, name: str, value: Any) -> None:
    if isinstance(value, Columns):
        columns = {f.name: np.asarray(getattr(value, f.name)) for f in fields(value)}
        only_bytes = all(column.dtype == np.uint8 for column in columns.values())
        arrays = {name: (arrow_of_bytes if only_bytes else arrow_of)(column) for name, column in columns.items()}
        # Dictionaries pay off for names and codes; measured values hardly repeat, but their first bytes are alike, side by side.
        measured = [name for name, column in columns.items() if column.dtype.kind == "f"]
        # Straight to the disk: in memory a file of a hundred megabytes would stand there three times while it grows.
        with depot.writing(name) as stream:
            pq.write_table(
                pa.table(arrays),
                stream,
                row_group_size=_PIECES if only_bytes else None,
                compression="zstd",
                use_dictionary=[] if only_bytes else [name for name in columns if name not in measured],
                use_byte_stream_split=measured,
                write_page_checksum=True,
            )
    else:
        depot.put(name, seal(to_json(value, indent=1, inf_nan_mode="constants")))


def read_table(depot: Depot, name: str, table: Table[Any]) -> Any:
    """The value of a stored table. Raises StoreError when it is absent or not of its type."""
    try:
        if issubclass(table.type, Columns):
            # One column after the other: all of them at once would be there twice, as stored and as numbers.
            with depot.source(name) as source, pq.ParquetFile(source, page_checksum_verification=True) as stored:
                return table.type(**{f.name: numpy_of(stored.read([f.name])[f.name]) for f in fields(table.type)})
        text = unsealed(depot.get(name))
        if text is None:
            raise ValueError("wrong checksum")
        return table.type.model_validate_json(text)
    except FileNotFoundError:
        raise StoreError(f"{depot.address}/{name} does not exist; run the stage '{table.path.split('/')[0]}' first.") from None
    # KeyError: a column that this version has and the file has not. ValueError: columns of different lengths, or invalid ones
    # (pydantic's and some of pyarrow's errors are among them); pyarrow reports damaged pages as OSError.
    except (KeyError, ValueError, OSError, pa.ArrowException) as error:
        raise StoreError(
            f"{depot.address}/{name} is damaged or from another version ({type(error).__name__}); find all damage with "
            "'orthomill verify', then run again."
        ) from error
