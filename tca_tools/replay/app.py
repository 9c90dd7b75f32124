"""The replay on the terminal: the actions of keys, and the passing of time."""

import signal
import sys
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.widgets import Footer, HelpPanel

from tca_tools.replay.panes import MessagesPane, Question, StoryPane, TimeBar, TreePane
from tca_tools.replay.recording import Recording
from tca_tools.replay.tree import rows_at
from tca_tools.terminal import is_hung_up
from tca_wire.journal.facts import Failed
from tca_wire.text.measures import counted
from tca_wire.text.printable import printable

FRAMES = 15
"""The number of times a second that the screen is drawn while time passes."""
SPEEDS = (0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0, 100.0, 500.0, 1000.0, 5000.0)
_LONG_STEP = 20
_LEAST_BESIDE = 90
"""The least columns for a story beside the tree; with fewer it is below the tree."""
_KEYS = (
    ("q", "leave", "quit"),
    ("space", "play", "play/pause"),
    ("right", "step(1)", "next message"),
    ("left", "step(-1)", "previous"),
    ("plus,equals_sign", "speed(1)", "faster"),
    ("minus", "speed(-1)", "slower"),
    ("right_square_bracket,f", "failure(1)", "next failure"),
    ("slash", "ask('name')", "search"),
    ("enter", "fold", "open/close"),
    ("question_mark", "help", "all keys"),
)
_MORE_KEYS = (
    ("left_square_bracket,F", "failure(-1)", "previous failure"),
    ("n", "search(1)", "next match"),
    ("N", "search(-1)", "previous match"),
    ("g", "ask('time')", "go to a time"),
    ("r", "turn", "reverse time"),
    ("up", "select(-1)", "task above"),
    ("down", "select(1)", "task below"),
    ("shift+right,ctrl+right", f"step({_LONG_STEP})", f"{_LONG_STEP} messages forward"),
    ("shift+left,ctrl+left", f"step({-_LONG_STEP})", f"{_LONG_STEP} messages back"),
    ("pageup", "scroll_story(-1)", "scroll the story up"),
    ("pagedown", "scroll_story(1)", "scroll the story down"),
    ("home", f"step({-sys.maxsize})", "first message"),
    ("end", f"step({sys.maxsize})", "last message"),
)
"""The keys with their actions: those in the footer, and those that only ``?`` shows."""

_QUESTIONS = {
    "time": "go to: seconds, such as 12.5",
    "name": "search: a task's number, or a part of a task's name or of a failure",
}


class Replay(App[None]):
    """The application, which shows a run message by message."""

    CSS_PATH = "app.tcss"
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (_LEAST_BESIDE, "-wide")]  # noqa: RUF012 - as in App
    BINDINGS: ClassVar = [
        *(Binding(key, action, words, priority=True) for key, action, words in _KEYS),
        *(
            Binding(key, action, words, show=False, priority=True)
            for key, action, words in _MORE_KEYS
        ),
        Binding("ctrl+c", "quit", "quit", show=False, priority=True),
        Binding("escape", "stop_asking", "cancel the question", show=False),
    ]
    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = ""
    """Only a question has the focus, so that all other keys reach the application."""

    def __init__(
        self, recording: Recording, name: str, *, speed: float = 1.0, at: float | None = None
    ) -> None:
        super().__init__()
        self.title = printable(name)
        self.recording = recording
        self.place = recording.last if at is None else recording.place_of(at)
        self.speed = speed
        self.direction = 1
        self.is_playing = False
        self.selected = 0
        self.follows_cursor = True
        """Whether each message selects the task that it is about. False once the user selects one.
        """
        self._opened: dict[int, bool] = {}
        self._clock = 0.0
        self._search_text = ""
        self._question = ""
        self._notice = ""
        self._terminal = None
        if sys.__stdin__ and sys.__stdin__.isatty():
            self._terminal = sys.__stdin__.fileno()

    def compose(self) -> ComposeResult:
        """Yield the panes."""
        panes = TreePane(self._select), StoryPane(self.recording), MessagesPane(self.recording)
        for pane, title in zip(panes, ("task tree", "story", "messages"), strict=True):
            pane.border_title = title
        yield TimeBar(self.recording, self._pause_at)
        with Vertical():
            with Horizontal(id="main"):
                yield from panes[:2]
            yield panes[2]
        yield Question(self._answer)
        yield Footer()

    def on_mount(self) -> None:
        """Start the timer when the screen is ready."""
        self.query_one("#sentences").can_focus = False
        self.set_interval(1 / FRAMES, self._advance)

    def on_resize(self) -> None:
        """Draw everything for the new size, with the notice of the last key."""
        self.call_after_refresh(lambda: self.go_to(self.place, self._notice))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool:
        """Disable most keys while the user types an answer."""
        del parameters
        is_typing = isinstance(self.focused, Question)
        return not is_typing or action in ("quit", "stop_asking")

    def action_leave(self) -> None:
        """End the replay."""
        self.exit()

    def go_to(self, place: int, notice: str = "") -> None:
        """Show the run after an event, with a notice."""
        recording = self.recording
        self.place = min(max(place, 0), recording.last)
        self._notice = notice
        at = recording.at(self.place)
        if self.follows_cursor and (task := self._task_at_cursor()):
            self.selected = task
        if self.selected not in at.tasks:
            self.selected = int(at.top[0]) if at.top else 0
        rows = rows_at(at, self.selected, self._opened)
        self.query_one(TreePane).show(rows, at, self.selected)
        self.query_one(StoryPane).show(self.selected, at)
        self.query_one(MessagesPane).place = self.place
        mode = "playing" if self.is_playing else "paused"
        heading = (
            self.title,
            f"{recording.time(self.place):.3f} s of {recording.time(recording.last):.3f} s",
            f"event {self.place + 1} of {recording.last + 1}",
            counted(recording.count_open_tasks(at), "open task"),
            f"{mode}{' backwards' * (self.direction < 0)}, speed {self.speed:g}",
            notice,
        )
        bar = self.query_one(TimeBar)
        bar.place, bar.heading = self.place, "   ".join(heading)

    def _task_at_cursor(self) -> int:
        """Return the task that the event at the cursor is about; a failed task is preferred."""
        facts = self.recording.events[self.place] if self.recording.events else []
        failed_first = sorted(facts, key=lambda fact: not isinstance(fact, Failed))
        return next(filter(None, map(self.recording.task_of, failed_first)), 0)

    # --- moving -----------------------------------------------------------------------------------

    def _advance(self) -> None:
        """Let time pass, or end if the terminal is closed.

        Not every terminal sends a signal when it closes; its input would then be read forever.
        """
        if self._terminal is not None and is_hung_up(self._terminal):
            signal.signal(signal.SIGHUP, signal.SIG_DFL)
            signal.raise_signal(signal.SIGHUP)
        if not self.is_playing:
            return
        self._clock += self.direction * self.speed / FRAMES
        place = self.recording.place_of(self._clock)
        start, end = self.recording.span
        self.is_playing = start < self._clock < end
        if place != self.place or not self.is_playing:
            self.go_to(place)

    def action_step(self, step: int) -> None:
        """Go to the next or previous message."""
        self._pause_at(self.place + step)

    def _pause_at(self, place: int) -> None:
        self.is_playing = False
        self.go_to(place)

    def action_play(self) -> None:
        """Play or pause; at the end, play from the start."""
        self.is_playing = not self.is_playing
        start, end = (0, self.recording.last)[:: self.direction]
        self.go_to(start if self.is_playing and self.place == end else self.place)
        self._clock = self.recording.time(self.place)

    def action_turn(self) -> None:
        """Reverse the direction of time."""
        self.direction = -self.direction
        self._clock = self.recording.time(self.place)
        self.go_to(self.place)

    def action_speed(self, step: int) -> None:
        """Play faster or slower."""
        others = [speed for speed in SPEEDS[::step] if (speed - self.speed) * step > 0]
        self.speed = next(iter(others), self.speed)
        self.go_to(self.place)

    def action_failure(self, step: int) -> None:
        """Go to the next or previous failure."""
        self.is_playing = False
        found = self.recording.next_failure(self.place, step)
        if found is None:
            self.go_to(self.place, f"no {'later' if step > 0 else 'earlier'} failure")
            return
        self.follows_cursor = True
        self.go_to(found)

    def action_help(self) -> None:
        """Show or hide the list of all keys."""
        if self.screen.query(HelpPanel):
            self.action_hide_help_panel()
        else:
            self.action_show_help_panel()
        self.on_resize()

    # --- selecting --------------------------------------------------------------------------------

    def action_select(self, step: int) -> None:
        """Select the task on the next or previous line."""
        rows = self.query_one(TreePane).rows
        tasks: list[int] = [row.task.id for row in rows if row.task]
        if tasks:
            place = tasks.index(self.selected) + step if self.selected in tasks else 0
            self._select(tasks[min(max(place, 0), len(tasks) - 1)])

    def _select(self, task: int) -> None:
        self.selected, self.follows_cursor = task, False
        self.go_to(self.place)

    def action_scroll_story(self, pages: int) -> None:
        """Scroll the story of the selected task."""
        self.query_one(StoryPane).scroll_pages(pages)

    def action_fold(self) -> None:
        """Unfold or fold the selected task."""
        rows = self.query_one(TreePane).rows
        for row in rows:
            if row.task and row.task.id == self.selected:
                below = [other.task for other in rows if other.parent == row.number]
                self._opened[self.selected] = not any(below)
                self._select(self.selected)
                return

    # --- asking -----------------------------------------------------------------------------------

    def action_ask(self, question: str) -> None:
        """Ask the user for a time or a text to search for."""
        self._question = question
        self.is_playing = False
        ask = self.query_one(Question)
        ask.value, ask.placeholder = "", _QUESTIONS[question]
        ask.add_class("asked")
        self.set_focus(ask)  # at once, for the next key may have been typed already

    def action_stop_asking(self) -> None:
        """Hide the question."""
        self.query_one(Question).remove_class("asked")
        self.set_focus(None)

    def _answer(self, text: str) -> None:
        """Act on the answer to a question."""
        self.action_stop_asking()
        if self._question == "name":
            self._search_text = text or self._search_text
            if self._search_text:
                self.action_search(1)
            return
        try:
            seconds = float(text.removesuffix("s"))
        except ValueError:
            notice = f"'{printable(text)}' is not a time: type seconds, such as 12.5"
            self.go_to(self.place, notice)
            return
        _, end = self.recording.span
        notice = f"the journal ends at {end:.3f} s" if seconds > end else ""
        self.go_to(self.recording.place_of(seconds), notice)

    def action_search(self, step: int) -> None:
        """Go to the next match of the search; after the last one, to the first."""
        if not self._search_text:
            self.action_ask("name")
            return
        recording, notice = self.recording, ""
        found = recording.search(self._search_text, self.place, step)
        if found is None:
            start = -1 if step > 0 else recording.last + 1
            found = recording.search(self._search_text, start, step)
            notice = f"search continued from the {'start' if step > 0 else 'end'}"
        if found is None:
            self.go_to(self.place, f"no task or failure '{printable(self._search_text)}'")
            return
        self.selected, self.follows_cursor = found.task, False
        self.go_to(found.place, notice)
