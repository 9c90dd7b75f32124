"""A run as Parquet: a file for each table, with typed columns, written in row groups."""

from collections.abc import Sequence
from itertools import islice
from typing import Any, BinaryIO

import pyarrow as pa
from pyarrow import parquet

from tca_tools.export.tables import ColumnType, Table
from tca_tools.journal.whole_run import Run

_ROWS_IN_A_GROUP = 1 << 16

_TYPES = {
    ColumnType.INTEGER: pa.int64(),
    ColumnType.SECONDS: pa.float64(),
    ColumnType.TEXT: pa.string(),
    ColumnType.FLAG: pa.bool_(),
    ColumnType.JSON: pa.string(),
}
_LARGEST = (1 << 63) - 1


def write_parquet(table: Table, run: Run, stream: BinaryIO) -> None:
    """Write one table."""
    schema = pa.schema([(name, _TYPES[kind]) for name, kind in table.columns.items()])
    with parquet.ParquetWriter(stream, schema, compression="zstd") as writer:
        all_rows = table.rows(run)
        while rows := list(islice(all_rows, _ROWS_IN_A_GROUP)):
            columns = [
                _column(column, kind)
                for column, kind in zip(zip(*rows, strict=True), schema.types, strict=True)
            ]
            writer.write_batch(pa.record_batch(columns, schema=schema))


def _column(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Return a column; integers that are too large for it become the largest possible one.

    Journals have integers up to 2^64.
    """
    try:
        return pa.array(values, kind)
    except OverflowError:
        return pa.array(
            [value if value is None else min(value, _LARGEST) for value in values], kind
        )
