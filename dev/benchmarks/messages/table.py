"""The report on a terminal."""

from collections.abc import Iterator

from dev.benchmarks.messages.results import Comparison, Report, Standing


def lines(report: Report) -> Iterator[str]:
    """Yield the tables one after the other, ratios first."""
    for table in report.tables:
        if table.rows:
            yield from _lines_of(table)
    for title, why in report.missing.items():
        yield f"left out: {title} ({why})"


def _lines_of(table: Comparison) -> Iterator[str]:
    better = "less" if table.is_less_better else "more"
    ratios = f"; ratios to {table.reference}" if table.reference else ""
    yield f"{table.case}, {table.unit} ({better} is better{ratios})"
    width = max(len(row.contestant) for row in table.rows)
    titles = f"{'ratio':>8} {'of rounds':>16} {'median':>12} {'p99':>10} {'best':>12} {'worst':>12}"
    yield f"  {'':{width}} {titles}"
    for row in table.rows:
        yield f"  {row.contestant:{width}} " + " ".join(_cells(row))
    yield ""


def _cells(row: Standing) -> Iterator[str]:
    yield f"{number(row.ratio):>8}"
    yield f"{ratio_range(row) or '-':>16}"
    for value, width in ((row.median, 12), (row.p99, 10), (row.best, 12), (row.worst, 12)):
        yield f"{number(value):>{width}}"


def ratio_range(row: Standing) -> str:
    """Return the least and the greatest ratio of a round; "" without a reference."""
    if row.ratio is None:
        return ""
    return f"{number(row.least_ratio)} - {number(row.most_ratio)}"


def number(value: float | None) -> str:
    """Return a figure with about three digits."""
    if value is None:
        return "-"
    for digits, least in ((0, 100), (1, 10), (2, 0.1)):
        if abs(value) >= least:
            return f"{value:,.{digits}f}"
    return f"{value:,.4f}"
