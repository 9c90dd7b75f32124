"""The panes of the replay: the tree, the messages around the cursor, the story of a task, and the bar of time.

Each draws only the lines that are seen.
"""

from collections.abc import Callable, Iterable, Iterator

from rich.text import Text
from textual.events import Click, Key
from textual.geometry import Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.widget import Widget
from textual.widgets import Footer, Input

from tca_tools.replay.recording import Recording
from tca_tools.replay.tree import Row
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import coped_with
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.text import COLOURS
from tca_tools.terminal import cut
from tca_tools.why.story import Sentence, story
from tca_tools.why.wait_words import age_of, coming, how, in_the_end, shown, told_now
from tca_wire.journal.facts import kind_of
from tca_wire.text.bodies import data_text
from tca_wire.text.printable import printable
from tca_wire.text.waits_in_words import several_in_words

_STATE_WIDTH = 11
_SHORTEST_NOTE = 8
_WHEEL = 2
"""Lines that the mouse wheel moves a story."""
_LEAST_STORY = 6
"""Lines of a story that are seen however much is said above it."""
_NAME_WIDTH = 44
_SHARE_OF_NAMES = 0.4
"""Of the pane's width; the rest is for states and reasons."""
_HANDLED = "yellow"
_TINTS = {True: "red", None: _HANDLED, False: ""}
"""Of what is bad news, or was (None)."""


def colour_of(standing: str) -> str:
    """As ``tca tree`` has it, but for what is too dark on many screens."""
    colour = COLOURS[standing]
    return "grey62" if colour == "bright_black" else colour


class TreePane(ScrollView, can_focus=True):
    """The task tree as it was, a line a task."""

    class Chosen(Message):
        """A task was clicked."""

        def __init__(self, task: int) -> None:
            super().__init__()
            self.task = task

    def __init__(self) -> None:
        super().__init__(id="tree")
        self.rows: list[Row] = []
        self.at: RunAt | None = None
        self.selected = 0
        self._name_width = 20

    def show(self, rows: list[Row], at: RunAt, selected: int) -> None:
        """Show other rows, and keep the selected one in sight."""
        self.rows, self.at, self.selected = rows, at, selected
        names = (len(row.guides) + len(self._called(row)) for row in rows)
        room = max(int(self.size.width * _SHARE_OF_NAMES), 20)
        self._name_width = min(max(names, default=20), _NAME_WIDTH, room)
        self.virtual_size = Size(self.size.width, len(rows))
        if (place := self.place_of(selected)) is not None:
            self.scroll_to_region(Region(0, place, 1, 1), animate=False, force=True, immediate=True)
        self.refresh()

    def place_of(self, task: int) -> int | None:
        """The line of a task."""
        return next((place for place, row in enumerate(self.rows) if row.task == task and task), None)

    def _called(self, row: Row) -> str:
        if not row.task or self.at is None:
            return f"+ {row.folded} more"
        return words.called(self.at.tasks[row.task]) + (f" + {row.folded}" if row.folded else "")

    def render_line(self, y: int) -> Strip:
        """One line, drawn when it is seen."""
        place = y + int(self.scroll_offset.y)
        if place >= len(self.rows) or self.at is None:
            return Strip.blank(self.size.width, self.rich_style)
        row, at = self.rows[place], self.at
        if not row.task:
            return self._strip(Text.assemble((f"{row.guides}{self._called(row)}", "dim")))
        task = at.tasks[row.task]
        standing = task.standing
        is_chosen = row.task == self.selected
        name = Text.assemble((row.guides, "dim"), (self._called(row), "bold reverse" if is_chosen else ""))
        name.truncate(self._name_width, overflow="ellipsis", pad=True)
        note = words.note_of(at, task)
        room = self.scrollable_content_region.width - self._name_width - _STATE_WIDTH - 3
        told = note.within(max(room, _SHORTEST_NOTE), at.time)
        return self._strip(
            Text.assemble(name, "  ", (f"{standing:{_STATE_WIDTH}}", colour_of(standing)), " ", (told, "dim"))
        )

    def _strip(self, line: Text) -> Strip:
        width = self.scrollable_content_region.width  # what the scroll bar covers is not seen
        line.truncate(width, overflow="ellipsis", pad=True)
        return (
            Strip(line.render(self.app.console), line.cell_len).adjust_cell_length(width).apply_style(self.rich_style)
        )

    def on_click(self, event: Click) -> None:
        """Choose the task under the mouse."""
        offset = event.get_content_offset(self)
        place = offset.y + int(self.scroll_offset.y) if offset else len(self.rows)
        if place < len(self.rows) and self.rows[place].task:
            self.post_message(self.Chosen(self.rows[place].task))


class MessagesPane(Widget):
    """The messages around the cursor, a line a fact; those of the event at the cursor stand out."""

    def __init__(self, recording: Recording) -> None:
        super().__init__(id="messages")
        self._recording = recording
        self._place = 0

    def show(self, place: int) -> None:
        """Show what is around another event."""
        self._place = place
        self.refresh()

    def render(self) -> Text:
        """As many lines as there is room for."""
        room = max(self.size.height, 1)
        here = self._lines(self._place)
        above: list[Text] = []
        place = self._place - 1
        while place >= 0 and len(above) < room // 3:
            above = [*self._lines(place), *above]
            place -= 1
        above = above[-(room // 3) :]
        lines = [*above, *here]
        place = self._place + 1
        while place <= self._recording.last and len(lines) < room:
            lines += self._lines(place)
            place += 1
        return Text("\n").join(lines[:room])

    def _lines(self, place: int) -> list[Text]:
        time, is_here = self._recording.time(place), place == self._place
        lines = []
        for number, fact in enumerate(self._recording.facts(place)):
            kind = kind_of(fact)
            start = f"{'>' if is_here else ' '}{time:9.3f}  " if not number else " " * 12
            said = (
                f"{kind:15} {printable(self._recording.wording.words(fact))}  {data_text(getattr(fact, 'body', b''))}"
            )
            style = _TINTS[self._recording.is_bad_news(place, fact, self._place)] or ("bold" if is_here else "dim")
            line = Text.assemble((start, "bold" if is_here else "dim"), (said.rstrip(), style))
            line.truncate(max(self.size.width, 1), overflow="ellipsis")
            line.no_wrap = True
            lines.append(line)
        return lines


class StoryPane(Widget):
    """What became of the selected task until now, and why it waits. The newest sentences are seen; others are scrolled
    to, with the mouse wheel or page up and down.
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__(id="story")
        self._recording = recording
        self._shown = 0
        self._at: RunAt | None = None
        self._back = 0
        """How many lines before the last the window ends."""

    def show(self, task: int, at: RunAt) -> None:
        """Show another task, or another moment."""
        self._shown, self._at, self._back = task, at, 0
        self.refresh()

    def scroll_by(self, lines: int) -> None:
        """Go back so many lines, or forward."""
        self._back = max(self._back + lines, 0)
        self.refresh()

    def on_mouse_scroll_up(self) -> None:
        """The wheel goes back."""
        self.scroll_by(_WHEEL)

    def on_mouse_scroll_down(self) -> None:
        """The wheel goes forward."""
        self.scroll_by(-_WHEEL)

    def render(self) -> Text:
        """What the task is and why it waits; below, the newest lines of its story, or those that were scrolled to."""
        at = self._at
        if at is None or self._shown not in at.tasks:
            return Text("no task is selected: up and down choose one, / looks for one", style="dim")
        task = at.tasks[self._shown]
        head = Text.assemble((printable(str(task)), "bold"), "  ", (task.standing, colour_of(task.standing)))
        lines = [head]
        if data := words.data(task):
            lines.append(Text.assemble((cut(data, 3 * max(self.size.width, 20)), "dim")))
        if waits := shown(at, task):
            told = f"{how(task)} {several_in_words(told_now(at, task, waits))}{words.lasting(age_of(waits), at.time)}"
            lines.append(Text.assemble((printable(told), "yellow")))
        if end := in_the_end(at, task):
            lines.append(Text.assemble((printable(f"in the end {end}"), "yellow")))
        lines += [Text.assemble((printable(said), "yellow")) for said in coming(at, task)]
        above = [line for text in lines for line in self._wrapped(text, self.size.width)]
        above = above[: max(self.size.height - _LEAST_STORY, 1)]
        sentences = [one for one in story(at.run, self._shown, at.moment) if one.time <= at.moment]
        body = [line for sentence in sentences for line in self._sentence(sentence, at)]
        room = max(self.size.height - len(above) - 1, 1)
        self._back = min(self._back, max(len(body) - room, 0))
        last = len(body) - self._back
        return Text("\n").join([*above, Text(), *body[max(last - room, 0) : last]])

    def _wrapped(self, text: Text, width: int) -> Iterable[Text]:
        """The lines that it takes."""
        return text.wrap(self.app.console, max(width, 1))

    def _sentence(self, sentence: Sentence, at: RunAt) -> Iterator[Text]:
        run, clock = self._recording.run, self._recording.time(self._recording.place_of_record(sentence.time))
        text = printable(sentence.by(at.moment, at.time))
        style = "red" if sentence.is_bad else ""
        if style and coped_with(run, run.tasks[self._shown], sentence.time, at.moment):
            style = _HANDLED
        start = f"{clock:9.3f}  "
        for line in self._wrapped(Text(text, style), self.size.width - len(start)):
            yield Text.assemble((start, "dim"), line)
            start = " " * len(start)


class TimeBar(Widget):
    """From the beginning to the end: where the cursor is, where something failed. A click goes there."""

    class Wanted(Message):
        """A place was clicked."""

        def __init__(self, place: int) -> None:
            super().__init__()
            self.place = place

    def __init__(self, recording: Recording, say: Callable[[], str]) -> None:
        super().__init__(id="bar")
        self._recording = recording
        self._say = say
        self.place = 0
        self._marks: tuple[int, dict[int, str]] = (0, {})
        """For a width, the columns in which something failed, and in which colour that is shown."""

    def show(self, place: int) -> None:
        """Move the cursor."""
        self.place = place
        self.refresh()

    def _column(self, place: int) -> int:
        recording = self._recording
        start, end = recording.time(0), recording.time(recording.last)
        share = (recording.time(place) - start) / (end - start) if end > start else 1.0
        return min(int(share * (self.size.width - 1)), self.size.width - 1)

    def render(self) -> Text:
        """The words above, the bar below."""
        width = max(self.size.width, 1)
        here = self._column(self.place)
        bar = Text("━" * here + "●" + "─" * (width - here - 1), style="cyan")
        if self._marks[0] != width:
            bad = {self._column(place): "red" for place in self._recording.bad}
            self._marks = width, {self._column(place): _HANDLED for place in self._recording.failures} | bad
        for column, colour in self._marks[1].items():
            bar.stylize(f"bold {colour}", column, column + 1)
        bar.stylize("bold white", here, here + 1)
        said = Text(self._say(), style="bold")
        said.truncate(width, overflow="ellipsis")
        return Text("\n").join([said, bar])

    def on_click(self, event: Click) -> None:
        """Go to the time under the mouse."""
        offset = event.get_content_offset(self)
        if offset is None:
            return
        recording = self._recording
        start, end = recording.time(0), recording.time(recording.last)
        wanted = start + (end - start) * offset.x / max(self.size.width - 1, 1)
        self.post_message(self.Wanted(recording.place_of(wanted)))


class Keys(Footer):
    """What the keys do, the most wanted first. What has no room is left out whole."""

    async def recompose(self) -> None:
        """Other keys do something now."""
        await super().recompose()
        self.call_after_refresh(self._fit)

    def on_resize(self) -> None:
        """There is more room, or less."""
        self.call_after_refresh(self._fit)

    def _fit(self) -> None:
        for key in self.children:
            key.visible = key.virtual_region.right <= self.size.width


class Question(Input):
    """A line to type in. It hands over the answer at once: keys that were typed fast after it are not part of it."""

    _ENTER = ("enter", "ctrl+j")
    """What terminals send, and what programs send that write a line."""

    def __init__(self, answer: Callable[[str], object]) -> None:
        super().__init__(id="ask")
        self._answer = answer

    def on_key(self, event: Key) -> None:
        """A key that came here: it may have been on its way when another pane got the focus."""
        if self.app.focused is not self:
            event.stop().prevent_default()
            self.app.post_message(Key(event.key, event.character))
        elif event.key in self._ENTER:
            event.stop().prevent_default()
            self._answer(self.value.strip())
