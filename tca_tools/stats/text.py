"""Statistics as tables for the terminal. Knows how they look; measures nothing."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

from tca_tools.stats.measure import MessageStats, Stats, Times
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.facts_in_words import place
from tca_wire.text.measures import counted, duration, run_time
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Outcome

_WIDTH = 100
"""Where nobody knows how wide the terminal is."""
_NARROWEST_NAME, _LEAST_NAME = 12, 4
"""Columns of a name for which others are left out, and that it has in any case."""
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
    """The heading over it and its neighbours."""
    head: str
    cell: Callable[[Any, float], object]
    """Makes a cell from the statistics of a row, and the seconds of the run."""
    spare: int = 0
    """Where there is no room, columns of the highest number are left out first; 0: never."""


def _spread(group: str, name: str, *spare: int) -> list[_Column]:
    """Three columns of times; *spare* are their numbers."""

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


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.0%}" if whole else _NONE


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
    _Column("", "waiting", lambda one, _: _share(one.use.waiting, one.use.busy) if one.use else _NONE, 4),
    _Column("queued", "times", lambda one, _: len(one.queued.seconds) or _NONE, 5),
    _Column("queued", "open", lambda one, _: len(one.queued.going_on) or _NONE, 3),
    *_spread("queued", "queued", 8, 2, 10),
    _Column("queued", "longest", lambda one, _: one.longest_queue or _NONE, 6),
)  # fmt: skip


def stats_lines(name: str, stats: Stats, width: int | None) -> list[str]:
    """A line of counts, and both tables, in lines of at most *width* columns (None: 100). Where
    there is no room they are without longest times, then without rates, medians and so on, as long
    as there is a number left.
    """
    tasks = [one for one in stats.messages if one.is_of_tasks]
    others = [one for one in stats.messages if not one.is_of_tasks]
    said = [_sum(tasks, "task")] if tasks else []
    said += [_sum(others, "other message" if tasks else "message")] if others else []
    still = " (still running)" * stats.is_live
    counts = ", ".join(said) or "0 messages"
    lines = [f"{name}: {stats.start:.2f} to {stats.end:.2f} s{still}, {counts}"]
    seconds, width = stats.end - stats.start, width or _WIDTH
    if stats.messages:
        rows = [(printable(one.message), one) for one in stats.messages]
        lines += _table("message", _MESSAGES, rows, seconds, width)
        if any(one.failed or one.resolved or one.killed or one.dropped for one in stats.messages):
            lines.append("sent to end: only of what was achieved or answered")
    if stats.resources:
        named = [
            (printable(place(one.module, one.resource) or "(no handler)"), one)
            for one in stats.resources
        ]
        table = _table("resource", _RESOURCES, named, seconds, width)
        start, end = stats.busy_in
        lines += [
            "",
            *table,
            f"busy: of {duration(end - start)} ({run_time(start)} to {run_time(end)})",
        ]
        lines += [f"{_AT_LEAST}: at least so long; some still wait"] * any(
            _AT_LEAST in line for line in table[2:]
        )
    if stats.deadlocks:
        lines.append(
            f"{counted(stats.deadlocks, 'deadlock')} found: 'tca report' tells which waits were refused"
        )
    return [cut(line, width) for line in lines]


def _sum(messages: Sequence[MessageStats], what: str) -> str:
    """``8 tasks (1 failed, 2 open)``."""
    news = [
        (sum(getattr(stats, ended) for stats in messages), words) for ended, words in _ENDS.items()
    ]
    said = ", ".join(f"{number} {ended}" for number, ended in news if number)
    total = counted(sum(stats.sent for stats in messages), what)
    return f"{total} ({said})" if said else total


def _table(
    title: str,
    columns: Sequence[_Column],
    rows: Sequence[tuple[str, object]],
    seconds: float,
    width: int,
) -> list[str]:
    """A line over groups of columns, a line of heads, and the rows. Columns with nothing in them
    are left out; where there is no room, others are, one after the other, then names are cut.
    """
    made = [(one, [one.head, *(str(one.cell(row, seconds)) for _, row in rows)]) for one in columns]
    kept = [(one, cells) for one, cells in made if {*cells[1:]} != {_NONE}]
    while (room := width - sum(map(len, _line("", kept, 0)))) < _NARROWEST_NAME:
        spared = max(one.spare for one, _ in kept)
        if not spared:
            break
        kept = [(one, cells) for one, cells in kept if one.spare != spared]
    names = [title, *(name for name, _ in rows)]
    name_width = min(max(map(columns_of, names)), max(room, _LEAST_NAME))
    lines = [
        "".join(_line(padded(name, name_width), kept, place)) for place, name in enumerate(names)
    ]
    return [_heads(name_width, kept), *lines]


def _line(name: str, columns: list[tuple[_Column, list[str]]], place: int) -> Iterator[str]:
    """A line of the table in pieces: the name, and cells as wide as their columns."""
    yield name
    for _, group in _groups(columns):
        for number, (_, cells) in enumerate(group):
            width = max(map(len, cells))
            yield " " * (2 if number == 0 else 1) + cells[place].rjust(width)


def _heads(name_width: int, columns: list[tuple[_Column, list[str]]]) -> str:
    """The headings over the groups of columns."""
    over = " " * name_width
    for name, group in _groups(columns):
        size = sum(max(map(len, cells)) + 1 for _, cells in group) - 1
        is_wide = name and len(name) + 2 <= size
        short = cut(name.removeprefix("sent "), size)
        head = f" {name} ".center(size, "-") if is_wide else short.center(size)
        over += f"  {head}"
    return over.rstrip()


def _groups(
    columns: list[tuple[_Column, list[str]]],
) -> Iterator[tuple[str, list[tuple[_Column, list[str]]]]]:
    return ((name, list(group)) for name, group in groupby(columns, key=lambda pair: pair[0].group))
