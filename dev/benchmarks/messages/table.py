"""The report as tables, ratios first: for a terminal, and for the page."""

from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

from dev.benchmarks.messages.results import Comparison, Report, Standing


class Table(NamedTuple):
    """A table of text. The first column has the contestants."""

    stage: str
    case: str
    unit: str
    is_less_better: bool
    head: list[str]
    rows: list[list[str]]


def tables(report: Report) -> Iterator[Table]:
    """Yield a table for each case. Columns without figures are left out."""
    for (stage, case), group in groupby(report.tables, lambda one: (one.stage, one.case)):
        parts = list(group)
        fullest_first = sorted(parts, key=lambda one: -len(one.rows))
        able = [row.contestant for one in fullest_first for row in one.rows]
        names = dict.fromkeys([*able, *(name for one in parts for name in one.unable)])
        found = _columns(parts[0]) if len(parts) == 1 else _parts(parts)
        columns = {title: cells for title, cells in found.items() if any(cells.values())}
        unit = parts[0].unit if len(parts) == 1 else ""
        rows = [[name, *(cells.get(name, "") for cells in columns.values())] for name in names]
        if names:
            yield Table(stage, case, unit, parts[0].is_less_better, ["", *columns], rows)


def _of(table: Comparison, figure: str) -> dict[str, str]:
    rows = {row.contestant: getattr(row, figure) for row in table.rows}
    return {name: number(value) for name, value in rows.items()}


def _columns(table: Comparison) -> dict[str, dict[str, str]]:
    """Return the columns of one figure, each with a cell for each contestant."""
    return {
        f"to {table.reference}": _of(table, "ratio"),
        "of rounds": {
            row.contestant: _range(row.least_ratio, row.most_ratio) for row in table.rows
        },
        "median": _of(table, "median") | table.unable,
        "p99": _of(table, "p99"),
        "best": _of(table, "best"),
        "worst": _of(table, "worst"),
        "broker, us": _of(table, "broker"),
    }


def _parts(parts: list[Comparison]) -> dict[str, dict[str, str]]:
    """Return a column for each of several figures, with medians and what they are between."""
    return {
        f"{one.part}, {one.unit}": {row.contestant: _with_range(row) for row in one.rows}
        | one.unable
        for one in parts
    }


def _with_range(row: Standing) -> str:
    median = number(row.median)
    return f"{median} ({_range(row.best, row.worst)})" if row.best != row.worst else median


def _range(least: float | None, most: float | None) -> str:
    return "" if least is None else f"{number(least)} - {number(most)}"


def lines(report: Report) -> Iterator[str]:
    """Yield the lines for a terminal."""
    for table in tables(report):
        better = "less" if table.is_less_better else "more"
        yield f"{table.case}{table.unit and ', '}{table.unit} ({better} is better)"
        widths = [max(map(len, cells)) for cells in zip(table.head, *table.rows, strict=True)]
        for name, *cells in (table.head, *table.rows):
            padded = [f"{cell:>{width}}" for cell, width in zip(cells, widths[1:], strict=True)]
            yield f"  {name:{widths[0]}}  " + "  ".join(padded)
        yield ""
    for title, why in report.missing.items():
        yield f"left out: {title} ({why})"


def number(value: float | None) -> str:
    """Return a figure with about three digits; "" for None."""
    if value is None:
        return ""
    if not value:
        return "0"
    for digits, least in ((0, 100), (1, 10), (2, 0.1)):
        if abs(value) >= least:
            return f"{value:,.{digits}f}"
    return f"{value:,.4f}"
