"""A run as Parquet: a file for each table, with typed columns, written in row groups."""

from itertools import islice
from typing import BinaryIO

import pyarrow as pa
from pyarrow import parquet

from tca_tools.export.tables import ColumnType, Table
from tca_tools.run.whole_run import Run

_ROWS_IN_A_GROUP = 1 << 16

_TYPES = {
    ColumnType.INTEGER: pa.int64(),
    ColumnType.SECONDS: pa.float64(),
    ColumnType.TEXT: pa.string(),
    ColumnType.FLAG: pa.bool_(),
    ColumnType.JSON: pa.string(),
}


def write_parquet(table: Table, run: Run, stream: BinaryIO) -> None:
    """Write one table."""
    schema = pa.schema([(name, _TYPES[kind]) for name, kind in table.columns.items()])
    with parquet.ParquetWriter(stream, schema, compression="zstd") as writer:
        found = table.rows(run)
        while rows := list(islice(found, _ROWS_IN_A_GROUP)):
            columns = [
                pa.array(column, kind) for column, kind in zip(zip(*rows, strict=True), schema.types, strict=True)
            ]
            writer.write_batch(pa.record_batch(columns, schema=schema))
