"""The screen of ``tca top``: tables that fit the terminal.

Only this file of the package imports rich.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tca_tools.live.top_frame import Frame, MessageLine, ResourceLine, WaitLine
from tca_wire.text.measures import counted
from tca_wire.text.printable import printable

_BAR = 8
_HEAD, _TABLE = 2, 3
"""Lines of the heading, and of a table without its rows."""
_LONG = 5.0
"""Seconds after which a wait is shown in red."""
_LEFT_OUT = ("messages",), ("messages", "held"), ("messages", "held", "resources")
_TRIES: Sequence[tuple[int, tuple[str, ...]]] = (
    (4, ()),
    *((rows, out) for out in _LEFT_OUT for rows in (4, 3, 2)),
)
"""The layouts to try, from the largest: rows that each table gets at least, tables to leave out.

The tables of waits and suspended tasks are never left out.
"""
_GROW = ("waits", "resources", "suspended", "held", "messages")
"""The tables that share the remaining rows, in turn."""
_ONE_LINE: dict[str, Any] = {"no_wrap": True, "overflow": "ellipsis"}
_NARROW = 110
"""Columns; a narrower terminal shows no bars."""


def console() -> Console:
    """Return the terminal."""
    return Console(highlight=False, markup=False, emoji=False)


def live(terminal: Console) -> Live:
    """Return a full screen for the frames; at its end the terminal is restored."""
    return Live(console=terminal, screen=True, auto_refresh=False, vertical_overflow="crop")


def screen(
    shown: Frame | None, address: str, trouble: str, height: int | None = None
) -> RenderableType:
    """Return a frame as tables.

    Args:
        shown: the frame; None before the first one.
        address: the address of central.
        trouble: the current problem, shown above the frame; "" if there is none.
        height: the lines to fill; None: as many as the tables need.
    """
    if shown is None:
        return Text(f"central at {address} is away: {trouble}", style="bold red")
    tables = _tables(shown)
    rooms = _rooms(tables, None if height is None else height - _HEAD - bool(trouble))
    parts = [tables[name]._replace(room=room) for name, room in rooms.items()]
    warning = [
        Text(f"central is away: {trouble}. Its last answer:", style="bold red", **_ONE_LINE)
    ] * bool(trouble)
    absent = ", ".join(name for name in tables if name not in rooms)
    no_room = [Text(f"no room for: {absent}", style="dim", **_ONE_LINE)] * bool(absent)
    return Group(*warning, _heading(shown, address), *parts, *no_room)


def _tables(shown: Frame) -> dict[str, "_Lines"]:
    """Return the tables, from top to bottom."""
    tables = {
        "resources": _Lines(_RESOURCES, shown.resources, _resource_cells, "no module has handlers"),
        "messages": _Lines(
            _MESSAGES, shown.messages, _message_cells, "no messages have been declared"
        ),
    }
    if shown.waits or not (shown.held or shown.suspended):
        tables["waits"] = _Lines(
            _WAITS, shown.waits, _wait_cells, "nothing waits", shown.totals["waits"]
        )
    if shown.suspended:
        tables["suspended"] = _Lines(
            _SUSPENDED, shown.suspended, _suspended_cells, "", shown.totals["suspended"]
        )
    if shown.held:
        among = f" among the {shown.tasks - shown.not_looked_at} oldest tasks" * (
            shown.not_looked_at > 0
        )
        tables["held"] = _Lines(_HELD, shown.held, _wait_cells, "", shown.totals["held"], among)
    return tables


def _heading(shown: Frame, address: str) -> Text:
    over = f"the last {shown.span:.1f} s" if shown.span < shown.time else "the whole run"
    there = f"{counted(shown.modules, 'module')}, {counted(shown.tasks, 'task')}"
    counts = f"{there}, {shown.events:.1f} events/s, {shown.memory}"
    return Text.assemble(
        (f"central at {address}", "bold"),
        f"  run {shown.epoch}, up {_long_time(shown.time)}\n{counts}; rates of {over}",
        **_ONE_LINE,
    )


def _rooms(tables: dict[str, "_Lines"], height: int | None) -> dict[str, int]:
    """Return the number of rows of each table. Tables without room are left out."""
    needed = {name: max(len(table.lines), 1) + table.is_cut for name, table in tables.items()}
    if height is None:
        return needed
    rooms: dict[str, int] = {}
    left = 0
    for fewest, left_out in _TRIES:
        rooms = {name: min(fewest, rows) for name, rows in needed.items() if name not in left_out}
        left = height - _TABLE * len(rooms) - sum(rooms.values()) - (len(rooms) < len(tables))
        if left >= 0:
            break
    while left > 0 and (
        short := [name for name in _GROW if name in rooms and rooms[name] < needed[name]]
    ):
        for name in short[:left]:
            rooms[name] += 1
        left -= len(short)
    return rooms


Column = tuple[str, dict[str, Any]]
_NUMBER: dict[str, Any] = {"justify": "right", "no_wrap": True}
_RESOURCES: Sequence[Column] = (
    ("resource", {**_ONE_LINE, "max_width": 30}),
    ("busy", _NUMBER),
    ("msg/s", _NUMBER),
    ("waiting", _NUMBER),
    ("handling", {**_ONE_LINE, "ratio": 1}),
)
_MESSAGES: Sequence[Column] = (
    ("message", {**_ONE_LINE, "ratio": 2}),
    ("class", {**_ONE_LINE, "ratio": 1}),
    ("msg/s", _NUMBER),
    ("runs", _NUMBER),
    ("failed runs", _NUMBER),
    ("dropped", _NUMBER),
    ("no handler", _NUMBER),
)
_WAITS: Sequence[Column] = (
    ("waits", _NUMBER),
    ("longest first", {**_ONE_LINE, "ratio": 1}),
    ("", {**_ONE_LINE, "ratio": 2}),
)
_SUSPENDED: Sequence[Column] = (
    ("suspended for", _NUMBER),
    *_WAITS[1:2],
    ("by", {**_ONE_LINE, "ratio": 1}),
    ("until", {**_ONE_LINE, "ratio": 1}),
)
_HELD: Sequence[Column] = (("held", _NUMBER), *_WAITS[1:2], ("", {**_ONE_LINE, "ratio": 2}))


class _Lines(NamedTuple):
    """A table with room for a number of rows."""

    columns: Sequence[Column]
    lines: Sequence[Any]
    cells: Callable[[Any, bool], list[Text | str]]
    """Makes the cells of a line; the flag says whether the terminal is wide."""
    nothing: str
    """The text without lines."""
    total: int = 0
    """The full number, if `lines` is only a part."""
    among: str = ""
    """The tasks among which central counted the lines, in words; "" for all."""
    room: int = 0

    @property
    def is_cut(self) -> bool:
        """Whether `lines` is only a part."""
        return self.total > len(self.lines) or bool(self.among)

    def __rich_console__(self, _: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        table = Table(
            box=SIMPLE_HEAD,
            expand=True,
            padding=(0, 1, 0, 0),
            pad_edge=False,
            show_edge=False,
            header_style="dim",
        )
        for name, how in self.columns:
            table.add_column(name, **how)
        is_whole = len(self.lines) + self.is_cut <= self.room
        shown = self.lines if is_whole else self.lines[: max(self.room - 1, 0)]
        for line in shown:
            table.add_row(*self.cells(line, options.max_width >= _NARROW))
        yield Text()
        yield table
        more = max(self.total, len(self.lines)) - len(shown)
        if more or self.among or not self.lines:
            words = f"... and {more or 'no'} more{self.among}" if self.lines else self.nothing
            yield Text(words, style="dim", **_ONE_LINE)


def _resource_cells(line: ResourceLine, is_wide: bool) -> list[Text | str]:
    """Return the cells of a resource.

    The name shows the number of slots. The handling shows the lock's holder and blocked slots.
    """
    name = line.module if line.resource in ("", line.module) else f"{line.module} / {line.resource}"
    full = round(line.busy * _BAR)
    bar = (("█" * full, "green"), ("░" * (_BAR - full) + " ", "dim")) if is_wide else ()
    busy = Text.assemble(*bar, (f"{line.busy:4.0%}", "" if is_wide or not full else "green"))
    waiting = Text()
    if line.waiting:
        waiting = Text.assemble((f"{line.waiting}, ", "yellow"), _wait(line.oldest))
    held = f"{printable(line.held)}  " * bool(line.held)
    number = f"{line.blocked} " * (line.capacity > 1)
    blocked = f"{number}blocked: " * bool(line.blocked)
    handling = printable(f"{line.handling}  {_time(line.seconds)}") if line.handling else ""
    slots = f" x{line.capacity}" * (line.capacity > 1)
    return [
        printable(name) + slots,
        busy,
        _rate(line.rate),
        waiting,
        Text.assemble((held + blocked, "yellow"), handling),
    ]


def _message_cells(line: MessageLine, _: bool) -> list[Text | str]:
    bad = [Text(str(number or ""), style="red") for number in (line.failed, line.dropped)]
    waiting = Text(str(line.waiting or ""), style="yellow")
    return [
        printable(line.message),
        line.message_class,
        _rate(line.rate),
        str(line.delivered),
        *bad,
        waiting,
    ]


def _wait_cells(line: WaitLine, _: bool) -> list[Text | str]:
    return [_wait(line.seconds), printable(line.what), printable(line.why)]


def _suspended_cells(line: WaitLine, _: bool) -> list[Text | str]:
    return [_wait(line.seconds), printable(line.what), printable(line.by), printable(line.why)]


def _wait(seconds: float) -> Text:
    return Text(_time(seconds), style="red" if seconds >= _LONG else "")


def _rate(rate: float) -> str:
    return f"{rate:.1f}" if rate >= 0.05 else "-"


def _time(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 100 else _long_time(seconds)


def _long_time(seconds: float) -> str:
    """``1:05``, ``2:00:07``, ``3 d 4:00:00``."""
    minutes, second = divmod(int(seconds), 60)
    hours, minute = divmod(minutes, 60)
    days, hour = divmod(hours, 24)
    clock = f"{hour}:{minute:02}:{second:02}" if hours else f"{minute}:{second:02}"
    return f"{days} d {clock}" if days else clock
