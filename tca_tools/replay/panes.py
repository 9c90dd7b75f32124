"""The panes of the replay: task tree, messages, story of a task, and time bar."""

from collections.abc import Callable
from itertools import count, islice
from operator import itemgetter

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Click, Key
from textual.geometry import Region, Size
from textual.reactive import reactive
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.widget import Widget
from textual.widgets import Input, RichLog, Static

from tca_tools.explain.story import story
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import has_run_survived
from tca_tools.journal.records import OVER
from tca_tools.replay.recording import Recording
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.outline import Row
from tca_tools.tasktree_viz.text import COLOURS, UNICODE, prefixes
from tca_tools.terminal import columns_of, cut
from tca_wire.journal.facts import kind_of
from tca_wire.text.bodies import data_text
from tca_wire.text.measures import counted
from tca_wire.text.printable import first_line, printable, printable_lines

_STATE_WIDTH = 11
_SHORTEST_NOTE = 8
_NAME_WIDTH, _LEAST_NAME = 44, 20
_SHARE_OF_NAMES = 0.4
"""The names' share of the pane's width; the rest is for states and reasons."""
_LEVELS = 8, 12
"""The number of levels with wide guides, and of levels after which the indent starts again."""
_LONGEST_DATA = 100
_LONGEST_STORY = 300
"""The most sentences of a story: the layout of thousands at each step would take seconds."""
_HANDLED = "yellow"
_TINTS = {True: "red", None: _HANDLED, False: ""}
"""The colours of facts: bad news, a failure that was dealt with (None), and others."""


def colour_of(standing: str) -> str:
    """Return the colour that ``tca tree`` uses, lighter if it is too dark on many screens."""
    colour = COLOURS[standing]
    return "grey62" if colour == "bright_black" else colour


class TreePane(ScrollView, can_focus=False):
    """The task tree at the cursor, a line for each task. Only visible lines are drawn."""

    def __init__(self, choose: Callable[[int], object]) -> None:
        super().__init__(id="tree")
        self._choose = choose
        self.rows: list[Row] = []
        self.at: RunAt | None = None
        self.selected = 0
        self._names: list[tuple[str, str]] = []
        """The guides and the label of each row."""
        self._name_width = _LEAST_NAME

    def show(self, rows: list[Row], at: RunAt, selected: int) -> None:
        """Show other rows, and scroll to the selected one."""
        self.rows, self.at, self.selected = rows, at, selected
        guides = [before for before, _ in prefixes(rows, UNICODE, *_LEVELS)]
        self._names = list(zip(guides, map(words.label, rows), strict=True))
        widest = max((columns_of(before + name) for before, name in self._names), default=0)
        room = max(int(self.size.width * _SHARE_OF_NAMES), _LEAST_NAME)
        self._name_width = min(max(widest, _LEAST_NAME), _NAME_WIDTH, room)
        self.virtual_size = Size(self.size.width, len(rows))
        for row in rows:
            if row.task and row.task.id == selected:
                self.scroll_to_region(
                    Region(0, row.number, 1, 1), animate=False, force=True, immediate=True
                )
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """Draw a visible line."""
        width = self.scrollable_content_region.width  # without the scroll bar
        place = y + int(self.scroll_offset.y)
        line = self._line(place, width) if place < len(self.rows) else Text()
        line.truncate(width, overflow="ellipsis", pad=True)
        strip = Strip(line.render(self.app.console), line.cell_len)
        return strip.apply_style(self.rich_style)

    def _line(self, place: int, width: int) -> Text:
        task, (guides, label), at = self.rows[place].task, self._names[place], self.at
        if task is None or at is None:
            return Text(guides + label, "dim")
        look = "bold reverse" if task.id == self.selected else ""
        name = Text.assemble((guides, "dim"), (label, look))
        name.truncate(self._name_width, overflow="ellipsis", pad=True)
        room = max(width - self._name_width - _STATE_WIDTH - 3, _SHORTEST_NOTE)
        note = words.note_of(at, task).within(room, at.time)
        state = f"{task.standing:{_STATE_WIDTH}}", colour_of(task.standing)
        return Text.assemble(name, "  ", state, " ", (note, "dim"))

    def on_click(self, event: Click) -> None:
        """Select the task under the mouse."""
        offset = event.get_content_offset(self)
        place = offset.y + int(self.scroll_offset.y) if offset else len(self.rows)
        if place < len(self.rows) and (task := self.rows[place].task):
            self._choose(task.id)


class MessagesPane(Widget):
    """The messages around the cursor, a line for each fact; the event at the cursor is bold."""

    place = reactive(0)
    """The cursor."""

    def __init__(self, recording: Recording) -> None:
        super().__init__(id="messages")
        self._recording = recording

    def render(self) -> Text:
        """Draw as many lines as fit."""
        room, here = max(self.size.height, 1), self.place
        end = len(self._recording.events)
        above: list[Text] = []
        for place in range(here - 1, -1, -1):
            if len(above) >= room // 3:
                break
            above[:0] = self._lines(place)
        below = (line for place in range(here, end) for line in self._lines(place))
        lines = [*above[max(len(above) - room // 3, 0) :], *islice(below, room)]
        return Text("\n").join(lines[:room])

    def _lines(self, place: int) -> list[Text]:
        recording, plain = self._recording, "bold" if place == self.place else "dim"
        time = f"{'>' if place == self.place else ' '}{recording.time(place):9.3f}  "
        lines = []
        for number, fact in zip(count(), recording.events[place], strict=False):
            text = f"{kind_of(fact):15} {printable(first_line(recording.wording.words(fact)))}  "
            text = (text + data_text(getattr(fact, "body", b""))).rstrip()
            tint = _TINTS[recording.badness(place, fact, self.place)]
            start = " " * len(time) if number else time
            lines.append(Text.assemble((start, plain), (text, tint or plain)))
            lines[-1].truncate(max(self.size.width, 1), overflow="ellipsis")
        return lines


class StoryPane(Vertical):
    """The story of the selected task up to the cursor, and why it waits.

    The newest sentences are visible; the user scrolls to others.
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__(id="story")
        self._recording = recording

    def compose(self) -> ComposeResult:
        """Yield the fixed part, and below it the part that scrolls."""
        yield Static(id="standing")
        yield RichLog(id="sentences", min_width=1)

    def show(self, number: int, at: RunAt) -> None:
        """Show another task, or another time."""
        head, log = self.query_one("#standing", Static), self.query_one(RichLog)
        log.clear()
        task = at.tasks.get(number)
        if task is None:
            text = "no task is selected: select one with up and down, or search with /"
            head.update(Text(text, style="dim"))
            return
        state = task.standing, colour_of(task.standing)
        lines = [Text.assemble((printable(str(task)), "bold"), "  ", state)]
        if data := words.data(task):
            lines.append(Text(cut(data, _LONGEST_DATA), "dim"))
        # The story of an ended task explains its end.
        if task.state not in OVER and (reason := words.note(at, task)):
            lines.append(Text(reason, "yellow"))
        head.update(Text("\n").join(lines))
        run, table = at.run, Table.grid(padding=(0, 2, 0, 0))
        whole = story(run, number, at.instant)
        sentences = [sentence for sentence in whole if sentence.time <= at.instant]
        if hidden := max(len(sentences) - _LONGEST_STORY, 0):
            number_hidden = counted(hidden, "earlier sentence")
            more = f"... {number_hidden}: 'tca tree --story {number}' prints all"
            table.add_row("", Text(more, "dim"))
        for sentence in sentences[hidden:]:
            clock = self._recording.time(self._recording.place_of_record(sentence.time))
            style = "red" if sentence.is_bad else ""
            if style and has_run_survived(run, run.tasks[number], sentence.time, at.instant):
                style = _HANDLED
            words_of = Text(printable_lines(sentence.text_at(at.instant, at.time)), style)
            table.add_row(Text(f"{clock:9.3f}", "dim", no_wrap=True), words_of)
        log.write(table, expand=True)

    def scroll_pages(self, pages: int) -> None:
        """Scroll the story by half pages; negative is back."""
        log = self.query_one(RichLog)
        log.scroll_relative(y=pages * max(log.size.height // 2, 1), animate=False)


class TimeBar(Widget):
    """A bar from the start to the end of the run, with the cursor and the failures.

    A click moves the cursor.
    """

    place = reactive(0)
    """The cursor."""
    heading = reactive("")
    """The line of text above the bar."""

    def __init__(self, recording: Recording, go_to: Callable[[int], object]) -> None:
        super().__init__(id="bar")
        self._recording = recording
        self._go_to = go_to

    def _column(self, place: int) -> int:
        last, time = self.size.width - 1, self._recording.time(place)
        start, end = self._recording.span
        return int((time - start) / (end - start) * last) if end > start else last

    def render(self) -> Text:
        """Draw the heading, and the bar below it."""
        width, here = max(self.size.width, 1), self._column(self.place)
        bar = Text("━" * here + "●" + "─" * (width - here - 1), style="cyan")
        failures = self._recording.failures.items()
        for place, is_bad in sorted(failures, key=itemgetter(1)):  # red last, over the others
            column = self._column(place)
            bar.stylize("bold red" if is_bad else f"bold {_HANDLED}", column, column + 1)
        bar.stylize("bold white", here, here + 1)
        text = Text(self.heading, style="bold")
        text.truncate(width, overflow="ellipsis")
        return Text("\n").join([text, bar])

    def on_click(self, event: Click) -> None:
        """Go to the time under the mouse."""
        if offset := event.get_content_offset(self):
            start, end = self._recording.span
            wanted = start + (end - start) * offset.x / max(self.size.width - 1, 1)
            self._go_to(self._recording.place_of(wanted))


class Question(Input):
    """A line to type an answer in.

    It handles Enter at once, so that keys typed right after it do not join the answer.
    """

    _ENTER = ("enter", "ctrl+j")
    """The key of terminals, and that of programs that write a line."""

    def __init__(self, answer: Callable[[str], object]) -> None:
        super().__init__(id="ask")
        self._answer = answer

    def on_key(self, event: Key) -> None:
        """Handle a key; pass it to the application if it arrives after the question has ended."""
        if self.app.focused is not self:
            event.stop().prevent_default()
            self.app.post_message(Key(event.key, event.character))
        elif event.key in self._ENTER:
            event.stop().prevent_default()
            self._answer(self.value.strip())
