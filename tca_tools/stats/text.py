"""Statistics as tables for the terminal."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

from tca_tools.analysis.resources import Use
from tca_tools.stats.measure import MessageStats, Stats, Times
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.facts_in_words import place
from tca_wire.text.measures import counted, duration, run_time
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Outcome

_WIDTH = 100
"""Columns if the width of the terminal is unknown."""
_NARROWEST_NAME, _LEAST_NAME = 12, 4
"""Columns of a name. If there is room for fewer than the first number, table columns are left out.
A name always has the second number.
"""
_AT_LEAST = "+"
_NONE = "-"
_ENDS = {
    "failed": "failed",
    "resolved": Outcome.RESOLVED,
    "killed": "killed",
    "dropped": "dropped",
    "open": "open",
}


class _Column(NamedTuple):
    """A column of a table."""

    group: str
    """The heading above it and its neighbours."""
    head: str
    cell: Callable[[Any, float], object]
    """Returns the content of a cell, from the statistics of a row and the seconds of the run."""
    spare: int = 0
    """The order in which columns are left out to save room, highest first; 0: never."""


_Cells = list[tuple[_Column, list[str]]]
"""The columns of a table, with their heads and cells."""


def _spread(group: str, name: str, *spare: int) -> list[_Column]:
    """Return three columns of times; *spare* are their places in the order of removal."""

    def cell(share: int, one: Any, _: float) -> str:
        return _time(getattr(one, name), share)

    heads = zip(("p50", "p99", "max"), (50, 99, 100), spare, strict=True)
    return [_Column(group, head, partial(cell, share), rank) for head, share, rank in heads]


def _time(times: Times, share: int) -> str:
    seconds = times.percentile(share)
    if seconds is None:
        return _NONE
    return duration(seconds) + _AT_LEAST * times.is_at_least(seconds)


def _rate(number: int, seconds: float) -> str:
    rate = number / (seconds or 1)
    return f"{rate:.2g}" if rate < 100 else f"{rate:.0f}"


def _waiting(use: Use | None) -> str:
    return f"{use.waiting / use.busy:.0%}" if use and use.busy else _NONE


_MESSAGES = (
    _Column("", "sent", lambda one, _: one.sent),
    _Column("", "/s", lambda one, seconds: _rate(one.sent, seconds), 8),
    _Column("", "open", lambda one, _: one.open or _NONE, 2),
    _Column("", "dropped", lambda one, _: one.dropped or _NONE, 4),
    _Column("runs", "failed", lambda one, _: one.failed_runs or _NONE, 5),
    *_spread("sent to start", "to_start", 7, 6, 9),
    *_spread("handling", "handling", 7, 1, 9),
    *_spread("sent to end", "to_end", 7, 3, 9),
)
_RESOURCES = (
    _Column("", "slots", lambda one, _: one.capacity or _NONE, 7),
    _Column("", "handled", lambda one, _: one.handled, 1),
    _Column("", "/s", lambda one, seconds: _rate(one.handled, seconds), 9),
    _Column("", "busy", lambda one, _: f"{one.use.share:.0%}" if one.use else _NONE),
    _Column("", "waiting", lambda one, _: _waiting(one.use), 4),
    _Column("queued", "times", lambda one, _: len(one.queued.seconds) or _NONE, 5),
    _Column("queued", "open", lambda one, _: len(one.queued.open_times) or _NONE, 3),
    *_spread("queued", "queued", 8, 2, 10),
    _Column("queued", "longest", lambda one, _: one.longest_queue or _NONE, 6),
)  # fmt: skip


def stats_lines(name: str, stats: Stats, width: int | None) -> list[str]:
    """Return a line of counts and both tables, in lines of at most *width* columns (None: 100).

    Narrow tables leave out longest times, then rates, medians and so on.
    """
    tasks = [one for one in stats.messages if one.is_of_tasks]
    others = [one for one in stats.messages if not one.is_of_tasks]
    parts = [_sum(tasks, "task")] if tasks else []
    parts += [_sum(others, "other message" if tasks else "message")] if others else []
    live = " (still running)" * stats.is_live
    counts = ", ".join(parts) or "0 messages"
    lines = [f"{name}: {stats.start:.2f} to {stats.end:.2f} s{live}, {counts}"]
    seconds, width = stats.end - stats.start, width or _WIDTH
    if stats.messages:
        rows = [(printable(one.message), one) for one in stats.messages]
        lines += _table("message", _MESSAGES, rows, seconds, width)
        if any(one.failed or one.resolved or one.killed or one.dropped for one in stats.messages):
            lines.append("sent to end: only achieved tasks and answered messages")
    if stats.resources:
        named = [
            (printable(place(one.module, one.resource) or "(no handler)"), one)
            for one in stats.resources
        ]
        table = _table("resource", _RESOURCES, named, seconds, width)
        start, end = stats.busy_in
        busy = f"busy: of {duration(end - start)} ({run_time(start)} to {run_time(end)})"
        lines += ["", *table, busy]
        if any(_AT_LEAST in line for line in table[2:]):
            lines.append(f"{_AT_LEAST}: at least; some still wait")
    if stats.deadlocks:
        lines.append(
            f"{counted(stats.deadlocks, 'deadlock')} found: 'tca report' shows the refused waits"
        )
    return [cut(line, width) for line in lines]


def _sum(messages: Sequence[MessageStats], noun: str) -> str:
    """Return ``8 tasks (1 failed, 2 open)``."""
    numbers = [
        (sum(getattr(stats, field) for stats in messages), words) for field, words in _ENDS.items()
    ]
    parts = ", ".join(f"{number} {words}" for number, words in numbers if number)
    total = counted(sum(stats.sent for stats in messages), noun)
    return f"{total} ({parts})" if parts else total


def _table(
    title: str,
    columns: Sequence[_Column],
    rows: Sequence[tuple[str, object]],
    seconds: float,
    width: int,
) -> list[str]:
    """Return a line of headings, a line of column heads, and the rows.

    Empty columns are left out. To save room, other columns are left out, one after the other. If
    that is not enough, names are cut.
    """
    all_columns = [
        (column, [column.head, *(str(column.cell(row, seconds)) for _, row in rows)])
        for column in columns
    ]
    shown = [(column, cells) for column, cells in all_columns if {*cells[1:]} != {_NONE}]
    while (room := width - sum(map(len, _line("", shown, 0)))) < _NARROWEST_NAME:
        spared = max(column.spare for column, _ in shown)
        if not spared:
            break
        shown = [(column, cells) for column, cells in shown if column.spare != spared]
    names = [title, *(name for name, _ in rows)]
    name_width = min(max(map(columns_of, names)), max(room, _LEAST_NAME))
    lines = [
        "".join(_line(padded(name, name_width), shown, place)) for place, name in enumerate(names)
    ]
    return [_heads(name_width, shown), *lines]


def _line(name: str, columns: _Cells, place: int) -> Iterator[str]:
    """Yield a line of the table in pieces: the name, and cells as wide as their columns."""
    yield name
    for _, group in _groups(columns):
        for number, (_, cells) in enumerate(group):
            width = max(map(len, cells))
            yield " " * (2 if number == 0 else 1) + cells[place].rjust(width)


def _heads(name_width: int, columns: _Cells) -> str:
    """Return the headings above the groups of columns."""
    heads = " " * name_width
    for name, group in _groups(columns):
        size = sum(max(map(len, cells)) + 1 for _, cells in group) - 1
        is_wide = name and len(name) + 2 <= size
        short = cut(name.removeprefix("sent "), size)
        head = f" {name} ".center(size, "-") if is_wide else short.center(size)
        heads += f"  {head}"
    return heads.rstrip()


def _groups(columns: _Cells) -> Iterator[tuple[str, _Cells]]:
    return ((name, list(group)) for name, group in groupby(columns, key=lambda pair: pair[0].group))
