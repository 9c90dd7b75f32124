"""How ``tca top`` looks: tables that fit the terminal. The only file of this package that imports rich."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tca_module.command_parts import printable
from tca_module.top_frame import Frame, MessageLine, ResourceLine, WaitLine

_BAR = 8
_HEAD, _TABLE = 2, 3
"""Lines of the heading, and of a table beside its rows."""
_LONG = 5.0
"""Seconds after which a wait is shown in red."""
_FEWEST = 3
"""Rows that each of three tables gets, however small the terminal is."""
_NARROW = 110
"""Columns below which the table of resources has fewer: then it fits into 80."""


def console() -> Console:
    """The terminal."""
    return Console(highlight=False, markup=False, emoji=False)


def live(terminal: Console) -> Live:
    """A screen of its own that frames are shown on, until it is left."""
    return Live(console=terminal, screen=True, auto_refresh=False, vertical_overflow="crop")


def screen(shown: Frame | None, address: str, trouble: str, height: int | None = None) -> RenderableType:
    """A frame, with what is wrong (*trouble*) above it, in so many lines (None: as many as it needs)."""
    if shown is None:
        return Text(f"central at {address} is away: {trouble}", style="bold red")
    rooms = _rooms(shown, None if height is None else height - _HEAD - (trouble != ""))
    tables: list[RenderableType] = [
        _Resources(shown.resources, rooms[0]),
        _table(_MESSAGES, shown.messages, _message_cells, rooms[1], "no messages have been declared"),
        _table(_WAITS, shown.waits, _wait_cells, rooms[2], "nobody waits"),
    ]
    if shown.held:
        tables.append(_table(_HELD, shown.held, _wait_cells, rooms[3], ""))
    warning = [Text(f"central is away: {trouble}. This is how it was:", style="bold red")] * (trouble != "")
    return Group(*warning, _heading(shown, address), *tables)


def _heading(shown: Frame, address: str) -> Text:
    over = f"the last {shown.span:.1f} s" if shown.span < shown.time else "the whole run"
    counts = f"{shown.modules} modules, {shown.tasks} tasks, {shown.events:.1f} events/s"
    return Text.assemble(
        (f"central at {address}", "bold"),
        f"  run {shown.epoch}, up {_long_time(shown.time)}\n{counts}; rates of {over}",
        no_wrap=True,
        overflow="ellipsis",
    )


def _rooms(shown: Frame, height: int | None) -> list[int]:
    """How many rows each table gets: what one does not need is for the others."""
    needed = [len(shown.resources), len(shown.messages), len(shown.waits)]
    needed += [len(shown.held)] * bool(shown.held)
    if height is None:
        return needed
    fewest = _FEWEST if len(needed) == _FEWEST else _FEWEST - 1
    room = max(height - _TABLE * len(needed) - 1, fewest * len(needed))
    rooms = [min(fewest, one) for one in needed]
    room -= sum(rooms)
    for place in (0, 2, *range(3, len(needed)), 1):
        more = min(max(needed[place] - rooms[place], 0), max(room, 0))
        rooms[place] += more
        room -= more
    return rooms


Column = tuple[str, dict[str, Any]]
_NUMBER: dict[str, Any] = {"justify": "right", "no_wrap": True}
_WORDS: dict[str, Any] = {"no_wrap": True, "overflow": "ellipsis"}
_RESOURCES: Sequence[Column] = (
    ("resource", {**_WORDS, "ratio": 2}), ("busy", {**_WORDS, "min_width": _BAR + 5}), ("msg/s", _NUMBER),
    ("slots", _NUMBER), ("blocked", _NUMBER), ("waiting", _NUMBER), ("oldest", _NUMBER),
    ("handling", {**_WORDS, "ratio": 3}),
)  # fmt: skip
_FEWER: Sequence[Column] = (
    ("resource", {**_WORDS, "max_width": 30}), ("busy", _NUMBER), ("msg/s", _NUMBER), ("waiting", _NUMBER),
    ("handling", {**_WORDS, "ratio": 1}),
)  # fmt: skip
_MESSAGES: Sequence[Column] = (
    ("message", {**_WORDS, "ratio": 2}), ("class", {**_WORDS, "ratio": 1}), ("msg/s", _NUMBER), ("delivered", _NUMBER),
    ("failed", _NUMBER), ("no handler", _NUMBER),
)  # fmt: skip
_WAITS: Sequence[Column] = (
    ("waits", _NUMBER),
    ("longest first", {**_WORDS, "ratio": 1}),
    ("for", {**_WORDS, "ratio": 1}),
)
_HELD: Sequence[Column] = (("held", _NUMBER), *_WAITS[1:2], ("until", {**_WORDS, "ratio": 1}))


class _Resources(NamedTuple):
    """The table of resources, as wide as there is room for."""

    lines: Sequence[ResourceLine]
    room: int

    def __rich_console__(self, _: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        columns, cells = (_FEWER, _fewer_cells) if options.max_width < _NARROW else (_RESOURCES, _resource_cells)
        yield _table(columns, self.lines, cells, self.room, "no module offers to handle anything")


def _table(
    columns: Sequence[Column], lines: Sequence[Any], cells: Callable[[Any], list[Text | str]], room: int, nothing: str
) -> RenderableType:
    table = Table(
        box=SIMPLE_HEAD, expand=True, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="dim"
    )
    for name, how in columns:
        table.add_column(name, **how)
    shown = lines if len(lines) <= room else lines[: max(room - 1, 0)]
    for line in shown:
        table.add_row(*cells(line))
    rest = Text(f"... and {len(lines) - len(shown)} more" if lines else nothing, style="dim")
    return Group(Text(), table, rest) if len(shown) < len(lines) or not lines else Group(Text(), table)


def _resource_cells(line: ResourceLine) -> list[Text | str]:
    full = round(line.busy * _BAR)
    bar = Text.assemble(("█" * full, "green"), ("░" * (_BAR - full), "dim"), f" {line.busy:4.0%}")
    waiting = Text(str(line.waiting or ""), style="yellow")
    return [
        _name(line), bar, _rate(line.rate), str(line.capacity), str(line.blocked or ""), waiting,
        _wait(line.oldest) if line.waiting else "", _doing(line),
    ]  # fmt: skip


def _fewer_cells(line: ResourceLine) -> list[Text | str]:
    """The same in fewer columns; several slots stand at the name, blocked ones where it says what is handled."""
    name = _name(line) + (f" x{line.capacity}" if line.capacity > 1 else "")
    busy = Text(f"{line.busy:.0%}", style="green" if line.busy >= 0.5 / _BAR else "dim")
    waiting = Text.assemble((f"{line.waiting}, ", "yellow"), _wait(line.oldest)) if line.waiting else Text()
    blocked = f"{line.blocked if line.capacity > 1 else ''} blocked: ".lstrip() if line.blocked else ""
    held = (f"{printable(line.held)}  " * bool(line.held), "yellow")
    return [name, busy, _rate(line.rate), waiting, Text.assemble(held, (blocked, "yellow"), _handled(line))]


def _name(line: ResourceLine) -> str:
    return printable(line.module if line.resource in ("", line.module) else f"{line.module} / {line.resource}")


def _doing(line: ResourceLine) -> Text:
    """What is handled, and who has it for himself."""
    handling = _handled(line)
    return Text.assemble(handling, "  " if handling and line.held else "", (printable(line.held), "yellow"))


def _handled(line: ResourceLine) -> str:
    return printable(f"{line.handling}  {_time(line.seconds)}") if line.handling else ""


def _message_cells(line: MessageLine) -> list[Text | str]:
    failed, waiting = Text(str(line.failed or ""), style="red"), Text(str(line.waiting or ""), style="yellow")
    return [printable(line.message), line.message_class, _rate(line.rate), str(line.delivered), failed, waiting]


def _wait_cells(line: WaitLine) -> list[Text | str]:
    return [_wait(line.seconds), printable(line.what), printable(line.why)]


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
