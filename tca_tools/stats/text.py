"""Statistics as tables for the terminal. Knows how they look; measures nothing."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate, compress

from tca_tools.analysis.words import counted, seconds
from tca_tools.stats.measure import MessageStats, ResourceStats, Stats, Times
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.text.facts_in_words import place
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
_NO_TIME = 0.5e-6
_UNITS = ((86400.0, "d", 3600.0, "h"), (3600.0, "h", 60.0, "m"), (60.0, "m", 1.0, "s"))

Cells = Sequence[str]
Groups = list[tuple[str, int]]
"""What stands over how many columns."""
Spare = Sequence[Sequence[int]]
"""Columns by their places, those that are left out first."""
_OPEN, _DROPPED, _OPEN_WAITS = 2, 3, 6
"""Columns that are shown where there is something in them."""
_SPARE_OF_MESSAGES: Spare = ((7, 10, 13), (1,), (5, 8, 11), (6,), (4,), (_DROPPED,), (12,), (_OPEN,), (9,))
_SPARE_OF_RESOURCES: Spare = ((9,), (2,), (7,), (0,), (10,), (5,), (4,), (_OPEN_WAITS,), (8,), (1,))


def stats_lines(
    stats: Stats, messages: Sequence[MessageStats], resources: Sequence[ResourceStats], width: int | None
) -> list[str]:
    """Both tables, in lines of at most *width* columns (None: 100): where there is no room, without longest times, then
    without rates, medians and so on, as long as there is a number left.
    """
    width = width or _WIDTH
    lines: list[str] = []
    if messages:
        groups = [("", 4), ("runs", 1), ("sent to start", 3), ("handling", 3), ("sent to end", 3)]
        heads = ["sent", "/s", "open", "dropped", "failed", *("p50", "p99", "max") * 3]
        rows = [(printable(one.name), _message_cells(one, stats.seconds)) for one in messages]
        lines += _table("message", groups, heads, rows, _SPARE_OF_MESSAGES, width, if_any=(_OPEN, _DROPPED))
        lines += [cut(line, width) for line in _left_out(stats)]
    if resources:
        groups = [("", 5), ("in the queue", 6)]
        heads = ["slots", "handled", "/s", "busy", "waiting", "queued", "open", "p50", "p99", "max", "longest"]
        titled = [(printable(place(one.module, one.resource) or _NO_HANDLER), one) for one in resources]
        rows = [(title, _resource_cells(one, stats.seconds)) for title, one in titled]
        table = _table("resource", groups, heads, rows, _SPARE_OF_RESOURCES, width, if_any=(_OPEN_WAITS,))
        lines += ["", *table, *(cut(line, width) for line in _notes(stats, table))]
    if stats.deadlocks:
        lines.append(
            cut(f"{counted(stats.deadlocks, 'deadlock')} found: who was refused to wait is in tca report", width)
        )
    return lines


def _left_out(stats: Stats) -> Iterator[str]:
    """What the column "sent to end" does not have."""
    tasks, queries = stats.tasks_in_vain, stats.queries_in_vain
    without = [f"{counted(tasks, 'task')} that failed or {'was' if tasks == 1 else 'were'} killed"] * bool(tasks)
    without += [f"{queries:,} {'query that was' if queries == 1 else 'queries that were'} dropped"] * bool(queries)
    if without:
        yield f"sent to end: without {' and '.join(without)}"


def _notes(stats: Stats, table: list[str]) -> Iterator[str]:
    """What has to be said of a table's figures."""
    start, end = stats.busy_in
    since = "" if stats.is_part else ", first task to last end" if stats.has_tasks else ", from the first message on"
    yield f"busy: of {seconds(max(end - start, 0.0))} ({start:.2f} to {end:.2f} s{since})"
    if any(_AT_LEAST in line for line in table[2:]):
        yield f"{_AT_LEAST}: at least so long; some still wait"


def _message_cells(stats: MessageStats, seconds: float) -> list[str]:
    counts = [str(stats.sent), _rate(stats.sent, seconds)]
    counts += [str(number or "-") for number in (stats.open, stats.dropped, stats.failed_runs)]
    return [*counts, *_spread(stats.to_start), *_spread(stats.handling), *_spread(stats.to_end)]


def _resource_cells(stats: ResourceStats, seconds: float) -> list[str]:
    waiting = f"{stats.busy.waiting / stats.busy.seconds:.0%}" if stats.busy.seconds else "-"
    handled = [str(stats.capacity or "-"), str(stats.handled), _rate(stats.handled, seconds)]
    handled += [f"{stats.busy.share:.0%}", waiting]
    queued = [str(len(stats.queued) or "-"), str(len(stats.queued.going_on) or "-"), *_spread(stats.queued)]
    return [*handled, *queued, str(stats.longest_queue or "-")]


def _spread(times: Times) -> list[str]:
    found = [times.percentile(share) for share in (50, 99, 100)]
    return [duration(one) + _AT_LEAST * (one is not None and times.is_at_least(one)) for one in found]


def _rate(number: int, seconds: float) -> str:
    rate = number / (seconds or 1)
    return f"{rate:.{2 if rate < _SELDOM else 3}g}" if seconds > 0 and rate < 1000 else f"{rate:.0f}"


def duration(seconds: float | None) -> str:
    """A time in at most six characters: ``850us``, ``1.25ms``, ``12.5s``, ``3m20s``, ``2h05m``."""
    if seconds is None or seconds < _NO_TIME:
        return "-" if seconds is None else "0"
    if seconds < 99.95:
        for factor, unit in ((1e6, "us"), (1e3, "ms"), (1.0, "s")):
            if seconds * factor < 999.5 or unit == "s":
                return _three_digits(seconds * factor) + unit
    for length, name, part, part_name in _UNITS:
        if seconds >= length:
            whole, rest = divmod(seconds, length)
            return f"{whole:.0f}{name}{rest // part:02.0f}{part_name}"
    return f"{seconds:.0f}s"


def _three_digits(number: float) -> str:
    digits = 2 if number < 9.995 else 1 if number < 99.95 else 0
    return f"{number:.{digits}f}".rstrip("0").rstrip(".") if digits else f"{number:.0f}"


def _table(
    title: str,
    groups: Groups,
    heads: list[str],
    rows: list[tuple[str, list[str]]],
    spare: Spare,
    width: int,
    *,
    if_any: Sequence[int],
) -> list[str]:
    """A line over groups of columns, a line of heads, and the rows; columns *if_any* only if something is in them.
    Where there is no room, columns are left out, those of *spare* one after the other, and names are cut.
    """
    all_sizes = [max(map(len, cells)) for cells in zip(heads, *(cells for _, cells in rows), strict=True)]
    kept = [n not in if_any or any(cells[n] != "-" for _, cells in rows) for n in range(len(heads))]
    waiting = list(spare)
    while True:
        sizes, left = list(compress(all_sizes, kept)), _left(groups, kept)
        gaps = [2 if place in _starts(left) else 1 for place in range(len(sizes))]
        room = width - sum(sizes) - sum(gaps)
        if room >= _NARROWEST_NAME or not waiting:
            break
        for spared in waiting.pop(0):
            kept[spared] = False
    name_width = min(max(columns_of(name) for name, _ in [(title, []), *rows]), max(room, _LEAST_NAME))
    over, place = " " * name_width, 0
    for name, number in left:
        size = sum(sizes[place : place + number]) + sum(gaps[place : place + number])
        over += "  " + _over(name, size - 2) if name and number else " " * size
        place += number
    told = [(name, list(compress(cells, kept))) for name, cells in [(title, heads), *rows]]
    lines = [over.rstrip(), *(_line(padded(name, name_width), cells, sizes, gaps) for name, cells in told)]
    return [cut(line, width) for line in lines]


def _left(groups: Groups, kept: list[bool]) -> Groups:
    """The groups with as many columns as are left of them."""
    ends = list(accumulate(number for _, number in groups))
    return [(name, sum(kept[end - number : end])) for (name, number), end in zip(groups, ends, strict=True)]


def _over(name: str, size: int) -> str:
    """What stands over a group of columns."""
    name = next((one for one in (name, name.removeprefix("sent ")) if len(one) <= size), _SHORT.get(name, name))
    return f" {name} ".center(size, "-") if len(name) + 2 <= size else cut(name, size).center(size)


def _starts(groups: Iterable[tuple[str, int]]) -> set[int]:
    starts, place = set(), 0
    for _, number in groups:
        starts.add(place)
        place += number
    return starts


def _line(name: str, cells: Cells, sizes: list[int], gaps: list[int]) -> str:
    return name + "".join(" " * gap + cell.rjust(size) for cell, size, gap in zip(cells, sizes, gaps, strict=True))
