"""Statistics as tables for the terminal. Knows how they look; measures nothing."""

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from tca_tools.stats.measure import MessageStats, ResourceStats, Stats, Times
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.facts_in_words import place
from tca_wire.text.measures import counted, duration, run_time
from tca_wire.text.printable import printable

_NO_HANDLER = "(no handler)"
_WIDTH = 100
"""Where nobody knows how wide the terminal is."""
_NARROWEST_NAME, _LEAST_NAME = 12, 4
"""Columns of a name for which others are left out, and that it has in any case."""
_SHORT = {"sent to start": "start", "handling": "run", "sent to end": "end", "in the queue": "queue"}
_SELDOM = 0.01
"""Of rates below this two digits are shown."""
_AT_LEAST = "+"
_NONE = "-"


class _Column(NamedTuple):
    """A column of a table."""

    group: str
    """The heading over it and its neighbours."""
    head: str
    cell: Callable[[Any, float], object]
    """Makes a cell from the statistics of a row, and the seconds of the run."""
    spare: int = 0
    """Where there is no room, columns of the highest number are left out first; 0: never."""
    if_any: bool = False
    """Whether it is shown only where there is something in it."""


def _spread(group: str, name: str, *spare: int) -> list[_Column]:
    """Three columns of times; *spare* are their numbers."""

    def cell(share: int) -> Callable[[Any, float], str]:
        return lambda one, _: _time(getattr(one, name), share)

    return [
        _Column(group, head, cell(share), rank)
        for head, share, rank in zip(("p50", "p99", "max"), (50, 99, 100), spare, strict=True)
    ]


def _time(times: Times, share: int) -> str:
    seconds = times.percentile(share)
    return _NONE if seconds is None else duration(seconds) + _AT_LEAST * times.is_at_least(seconds)


def _rate(number: int, seconds: float) -> str:
    rate = number / (seconds or 1)
    return f"{rate:.{2 if rate < _SELDOM else 3}g}" if seconds > 0 and rate < 1000 else f"{rate:.0f}"


_MESSAGES = (
    _Column("", "sent", lambda one, _: one.sent),
    _Column("", "/s", lambda one, seconds: _rate(one.sent, seconds), 8),
    _Column("", "open", lambda one, _: one.open or _NONE, 2, if_any=True),
    _Column("", "dropped", lambda one, _: one.dropped or _NONE, 4, if_any=True),
    _Column("runs", "failed", lambda one, _: one.failed_runs or _NONE, 5),
    *_spread("sent to start", "to_start", 7, 6, 9),
    *_spread("handling", "handling", 7, 1, 9),
    *_spread("sent to end", "to_end", 7, 3, 9),
)
_RESOURCES = (
    _Column("", "slots", lambda one, _: one.capacity or _NONE, 7),
    _Column("", "handled", lambda one, _: one.handled, 1),
    _Column("", "/s", lambda one, seconds: _rate(one.handled, seconds), 9),
    _Column("", "busy", lambda one, _: f"{one.busy.share:.0%}"),
    _Column("", "waiting", lambda one, _: f"{one.busy.waiting / one.busy.seconds:.0%}" if one.busy.seconds else "-", 4),
    _Column("in the queue", "queued", lambda one, _: len(one.queued) or _NONE, 5),
    _Column("in the queue", "open", lambda one, _: len(one.queued.going_on) or _NONE, 3, if_any=True),
    *_spread("in the queue", "queued", 8, 2, 10),
    _Column("in the queue", "longest", lambda one, _: one.longest_queue or _NONE, 6),
)


def stats_lines(
    stats: Stats, messages: Sequence[MessageStats], resources: Sequence[ResourceStats], width: int | None
) -> list[str]:
    """Both tables, in lines of at most *width* columns (None: 100): where there is no room, without longest times, then
    without rates, medians and so on, as long as there is a number left.
    """
    width = width or _WIDTH
    lines: list[str] = []
    if messages:
        rows = [(printable(one.name), one) for one in messages]
        lines += [*_table("message", _MESSAGES, rows, stats.seconds, width), *_left_out(stats)]
    if resources:
        titled = [(printable(place(one.module, one.resource) or _NO_HANDLER), one) for one in resources]
        table = _table("resource", _RESOURCES, titled, stats.seconds, width)
        lines += ["", *table, *_notes(stats, table)]
    if stats.deadlocks:
        lines.append(f"{counted(stats.deadlocks, 'deadlock')} found: 'tca report' tells which waits were refused")
    return [cut(line, width) for line in lines]


def _left_out(stats: Stats) -> Iterator[str]:
    """The messages that are in no figure of "sent to end"."""
    tasks, queries = stats.tasks_in_vain, stats.queries_in_vain
    without = [f"{counted(tasks, 'task')} that failed or {'was' if tasks == 1 else 'were'} killed"] * bool(tasks)
    without += [f"{queries:,} {'query that was' if queries == 1 else 'queries that were'} dropped"] * bool(queries)
    if without:
        yield f"sent to end: without {' and '.join(without)}"


def _notes(stats: Stats, table: list[str]) -> Iterator[str]:
    """Notes below a table."""
    start, end = stats.busy_in
    since = "" if stats.is_part else ", first task to last end" if stats.has_tasks else ", from the first message on"
    yield f"busy: of {duration(max(end - start, 0.0))} ({run_time(start)} to {run_time(end)}{since})"
    if any(_AT_LEAST in line for line in table[2:]):
        yield f"{_AT_LEAST}: at least so long; some still wait"


def _table(
    title: str, columns: Sequence[_Column], rows: Sequence[tuple[str, object]], seconds: float, width: int
) -> list[str]:
    """A line over groups of columns, a line of heads, and the rows. Where there is no room, columns are left out one
    after the other, then names are cut.
    """
    made = [(one, [one.head, *(str(one.cell(row, seconds)) for _, row in rows)]) for one in columns]
    kept = [(one, cells) for one, cells in made if not one.if_any or {*cells[1:]} != {_NONE}]
    while (room := width - sum(map(len, _line("", kept, 0)))) < _NARROWEST_NAME:
        spared = max(one.spare for one, _ in kept)
        if not spared:
            break
        kept = [(one, cells) for one, cells in kept if one.spare != spared]
    names = [title, *(name for name, _ in rows)]
    name_width = min(max(map(columns_of, names)), max(room, _LEAST_NAME))
    return [_heads(name_width, kept)] + [
        "".join(_line(padded(name, name_width), kept, place)) for place, name in enumerate(names)
    ]


def _line(name: str, columns: list[tuple[_Column, list[str]]], place: int) -> Iterator[str]:
    """A line of the table in pieces: the name, and cells as wide as their columns."""
    yield name
    for _, group in _groups(columns):
        for number, (_, cells) in enumerate(group):
            yield " " * (2 if number == 0 else 1) + cells[place].rjust(max(map(len, cells)))


def _heads(name_width: int, columns: list[tuple[_Column, list[str]]]) -> str:
    """The headings over the groups of columns."""
    over = " " * name_width
    for name, group in _groups(columns):
        size = sum(max(map(len, cells)) + 1 for _, cells in group) - 1
        short = next((one for one in (name, name.removeprefix("sent ")) if len(one) <= size), _SHORT.get(name, name))
        told = f" {short} ".center(size, "-") if name and len(short) + 2 <= size else cut(short, size).center(size)
        over += "  " + told
    return over.rstrip()


def _groups(columns: list[tuple[_Column, list[str]]]) -> Iterator[tuple[str, list[tuple[_Column, list[str]]]]]:
    return ((name, list(group)) for name, group in groupby(columns, key=lambda pair: pair[0].group))
