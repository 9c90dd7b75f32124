"""A run as CSV: a file for each table, with a line of column names (RFC 4180; UTF-8, empty where nothing is known)."""

import csv
import io
from typing import BinaryIO

from tca_tools.export.tables import Kind, Row, Table, batches
from tca_tools.run.whole_run import Run

_ROWS_AT_ONCE = 1 << 12


def write_csv(table: Table, run: Run, stream: BinaryIO) -> None:
    """Write one table."""
    text = io.TextIOWrapper(stream, "utf-8", newline="", write_through=True)
    writer = csv.writer(text)
    writer.writerow(table.columns)
    flags = [place for place, kind in enumerate(table.columns.values()) if kind is Kind.FLAG]
    for rows in batches(table, run, _ROWS_AT_ONCE):
        writer.writerows(_with_words(row, flags) for row in rows)
    text.detach()


def _with_words(row: Row, flags: list[int]) -> Row:
    """A row whose flags are words that every reader of CSV takes for truth values."""
    words = {True: "true", False: "false", None: None}
    return tuple(words[value] if place in flags else value for place, value in enumerate(row)) if flags else row
