"""A run as CSV: a file for each table, with a line of column names (RFC 4180; UTF-8, empty where nothing is known)."""

import csv
import io
from typing import BinaryIO

from tca_tools.export.tables import Table
from tca_tools.run.whole_run import Run


def write_csv(table: Table, run: Run, stream: BinaryIO) -> None:
    """Write one table. Flags are words that every reader of CSV takes for truth values."""
    text = io.TextIOWrapper(stream, "utf-8", newline="")
    writer = csv.writer(text)
    writer.writerow(table.columns)
    for row in table.rows(run):
        writer.writerow(str(value).lower() if isinstance(value, bool) else value for value in row)
    text.detach()
